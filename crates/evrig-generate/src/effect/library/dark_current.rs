//! Dark current: current without light joins the photocurrent.
//!
//! The photodiode's leakage adds a constant to the intensity inside the logarithm (Lichtsteiner et
//! al. 2008). Signature: contrast is compressed in the dark, by I/(I + d).

use crate::effect::model::EffectModel;
use crate::effect::pixel_site::{PixelSite, SiteSignal};

effect! {
    /// A constant beside the photocurrent.
    DarkCurrent, Photodiode, "x = ln(I + d), I and d over white" {
        /// Dark current over the photocurrent of white paper.
        fraction_of_white: 0.0 to 10.0,
    }
}

impl EffectModel for DarkCurrent {
    fn apply_to_signal(&self, _site: &PixelSite<'_>, signal: &mut SiteSignal<'_>) {
        let dark = self.fraction_of_white as f32;
        signal.values.iter_mut().for_each(|x| *x = (x.exp() + dark).ln());
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::test_support::*;
    #[test]
    fn contrast_is_compressed_in_the_dark_and_hardly_in_the_light() {
        let kept = |level: f64| {
            let light = passing(2.0, level);
            let with = events(&light, 2.0, &["dark_current:fraction_of_white=0.02"]).len();
            with as f64 / events(&light, 2.0, &[]).len() as f64
        };
        let (bright, dark) = (kept(-0.6), kept(-4.0));
        assert!(bright > 0.9, "{bright}");
        // At I = 0.018 about half of the contrast is left.
        assert!((0.3..0.6).contains(&dark), "{dark}");
    }
}
