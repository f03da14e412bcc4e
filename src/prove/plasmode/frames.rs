//! Effects of the frame camera and its lens, applied to frames.

use super::recording::PlasmodeRecording;
use evrig_core::frame::Samples;

/// A pedestal that no one stated.
pub(super) fn pedestal(offset_dn: f64) -> impl Fn(f64, f64) -> f64 {
    move |value, _| value + offset_dn
}

/// A curve between light and value that keeps black and full scale.
pub(super) fn gamma(gamma: f64) -> impl Fn(f64, f64) -> f64 {
    move |value, full| full * (value / full).powf(gamma)
}

/// Changes every sample by a curve of the sample and the full scale.
pub(super) fn change(recording: &mut PlasmodeRecording, curve: impl Fn(f64, f64) -> f64) {
    for frame in &mut recording.frames {
        match &mut frame.samples {
            Samples::U8(samples) => {
                let full = f64::from(u8::MAX);
                let table: Vec<u8> = (0..=u8::MAX)
                    .map(|v| curve(f64::from(v), full).round().clamp(0.0, full) as u8)
                    .collect();
                samples.iter_mut().for_each(|v| *v = table[usize::from(*v)]);
            }
            Samples::U16(samples) => {
                let full = f64::from(u16::MAX);
                let new = |v: u16| curve(f64::from(v), full).round().clamp(0.0, full) as u16;
                samples.iter_mut().for_each(|v| *v = new(*v));
            }
        }
    }
}

/// Blurs every frame with a Gaussian; the border is repeated outwards.
pub(super) fn blur(recording: &mut PlasmodeRecording, sigma_px: f64) {
    let radius = (4.0 * sigma_px).ceil().max(1.0) as usize;
    let weight = |i: usize| (-0.5 * ((i as f64 - radius as f64) / sigma_px).powi(2)).exp();
    let kernel: Vec<f64> = (0..=2 * radius).map(weight).collect();
    let sum: f64 = kernel.iter().sum();
    let kernel: Vec<f64> = kernel.into_iter().map(|w| w / sum).collect();
    for frame in &mut recording.frames {
        let (width, height) = (usize::from(frame.size.width), usize::from(frame.size.height));
        let n_channels = frame.channels.count();
        let blurred = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
            let shape = [width, height, n_channels];
            let rows = along(&kernel, shape, true, value);
            along(&kernel, shape, false, &|i| rows[i])
        };
        match &mut frame.samples {
            Samples::U8(samples) => {
                let new = blurred(&|i| f64::from(samples[i]));
                samples.iter_mut().zip(new).for_each(|(v, new)| *v = new.round() as u8);
            }
            Samples::U16(samples) => {
                let new = blurred(&|i| f64::from(samples[i]));
                samples.iter_mut().zip(new).for_each(|(v, new)| *v = new.round() as u16);
            }
        }
    }
}

/// One direction of a separable filter, channel by channel.
fn along(
    kernel: &[f64],
    [width, height, n_channels]: [usize; 3],
    is_along_row: bool,
    value: &dyn Fn(usize) -> f64,
) -> Vec<f64> {
    let radius = kernel.len() / 2;
    let near = |at: usize, k: usize, n: usize| (at + k).saturating_sub(radius).min(n - 1);
    let mut out = Vec::with_capacity(width * height * n_channels);
    for y in 0..height {
        for x in 0..width {
            for channel in 0..n_channels {
                let tap = |k: usize| {
                    let (x, y) =
                        if is_along_row { (near(x, k, width), y) } else { (x, near(y, k, height)) };
                    value((y * width + x) * n_channels + channel)
                };
                out.push(kernel.iter().enumerate().map(|(k, w)| w * tap(k)).sum());
            }
        }
    }
    out
}
