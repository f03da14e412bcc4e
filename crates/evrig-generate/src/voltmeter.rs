//! The paper's event model: a pixel's voltage is a Brownian motion whose drift and
//! diffusion follow the brightness (Lin et al., DVS-Voltmeter, ECCV 2022; Raw2Event).
//!
//! Between two frames dV = μ dt + σ dW with [`Coefficients::motion`]'s μ and σ; V fires
//! On at +1, OFF at −1, restarts at 0 and is carried from frame to frame.
//!
//! Two forms draw from the same law: `scalar` is plain, `lazy` is fast and tested against it.
//! The published program's shortcuts are in `reference`.

pub mod closed_form;
mod coefficients;
mod law;
mod lazy;
mod passage;
mod reference;
mod scalar;

#[cfg(test)]
mod law_tests;
#[cfg(test)]
mod lazy_tests;
#[cfg(test)]
mod tests;

pub use coefficients::{Coefficients, DriftDiffusion};
pub use law::VoltmeterLaw;
pub(super) use lazy::LazyVoltmeter;
#[cfg(test)]
use lazy::Voltages;
pub(super) use passage::{bridge_crosses, crossing_share};
pub(super) use scalar::ScalarVoltmeter;
