//! Splits into training and evaluation parts by a hash: an added session moves no other one, and
//! two copies of a recording are always in the same part.

use super::BatchError;
use evrig_session::{Manifest, sha256_of_bytes};
use serde::{Deserialize, Serialize};

/// A named part of a dataset.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SplitShare {
    /// Its name: `train`.
    pub name: String,
    /// Its part of all sessions, 0 to 1.
    pub share: f64,
}

/// What no two parts have in common.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SplitBy {
    /// A recording.
    #[default]
    Recording,
    /// An image that was shown while recording: all recordings of it are in one part. A session
    /// that states no image counts as one of its own.
    Stimulus,
}

/// How a dataset is split; the shares add up to one.
#[derive(Debug, Clone, PartialEq)]
pub struct Splits {
    shares: Vec<SplitShare>,
    by: SplitBy,
    seed: u64,
}

impl Default for Splits {
    fn default() -> Self {
        let share = |name: &str, share| SplitShare { name: name.into(), share };
        Self::of_shares(vec![share("train", 0.8), share("val", 0.1), share("test", 0.1)])
    }
}

impl Splits {
    /// Reads `train=0.8,val=0.1,test=0.1`.
    ///
    /// # Errors
    /// When a part has no name or no share, or the shares do not add up to one.
    pub fn parse(text: &str) -> Result<Self, BatchError> {
        let wrong = |what: String| BatchError::Splits { text: text.to_owned(), what };
        let mut shares: Vec<SplitShare> = Vec::new();
        for part in text.split(',') {
            let Some((name, share)) = part.split_once('=') else {
                return Err(wrong(format!("`{part}` has no `=`")));
            };
            let share: f64 =
                share.trim().parse().map_err(|_| wrong(format!("`{share}` is no number")))?;
            let name = name.trim().to_owned();
            if name.is_empty() || shares.iter().any(|other| other.name == name) {
                return Err(wrong(format!("`{part}` needs a unique name")));
            }
            if !(0.0..=1.0).contains(&share) {
                return Err(wrong(format!("{share} is no share between 0 and 1")));
            }
            shares.push(SplitShare { name, share });
        }
        let sum: f64 = shares.iter().map(|share| share.share).sum();
        if (sum - 1.0).abs() > 1e-6 {
            return Err(wrong(format!("the shares add up to {sum}, not to 1")));
        }
        Ok(Self::of_shares(shares))
    }

    pub(super) fn of_shares(shares: Vec<SplitShare>) -> Self {
        Self { shares, by: SplitBy::default(), seed: 0 }
    }

    /// The same shares, by something else, or shared out anew with another seed.
    #[must_use]
    pub fn drawn(self, by: SplitBy, seed: u64) -> Self {
        Self { by, seed, ..self }
    }

    /// The shares as [`Self::parse`] reads them.
    #[must_use]
    pub fn text(&self) -> String {
        let parts: Vec<String> =
            self.shares.iter().map(|part| format!("{}={}", part.name, part.share)).collect();
        parts.join(",")
    }

    /// The parts.
    #[must_use]
    pub fn shares(&self) -> &[SplitShare] {
        &self.shares
    }

    /// What no two parts have in common.
    #[must_use]
    pub const fn by(&self) -> SplitBy {
        self.by
    }

    /// The seed.
    #[must_use]
    pub const fn seed(&self) -> u64 {
        self.seed
    }

    /// The part a session is in, from the checksums of the image or of what was recorded.
    #[must_use]
    pub fn of(&self, manifest: &Manifest) -> &str {
        let mut text = if self.seed == 0 { String::new() } else { format!("{} ", self.seed) };
        if let (SplitBy::Stimulus, Some(image)) = (self.by, stimulus(manifest)) {
            return self.at(fraction(&format!("{text}stimulus {image}")));
        }
        for (file, entry) in &manifest.files {
            // The journal contains when a session was made and differs between imports of one
            // recording.
            if file != "journal.jsonl" {
                text.push_str(&format!("{} ", entry.sha256));
            }
        }
        self.at(fraction(&text))
    }

    fn at(&self, fraction: f64) -> &str {
        let mut end = 0.0;
        for share in &self.shares {
            end += share.share;
            if fraction < end {
                return &share.name;
            }
        }
        // The sum may fall short of one by rounding.
        self.shares.iter().rfind(|share| share.share > 0.0).map_or("all", |share| &share.name)
    }
}

/// SHA-256 of the image that was shown while a session was recorded; none where it states none.
#[must_use]
pub fn stimulus(manifest: &Manifest) -> Option<&str> {
    let recording = manifest.recording.as_ref()?;
    let shown = recording.devices.iter().find(|device| device.name == "stimulus")?;
    shown.description.get("sha256")?.as_str()
}

/// A pseudorandom number in 0..1 determined by the text.
fn fraction(text: &str) -> f64 {
    let hash = sha256_of_bytes(text.as_bytes()).to_string();
    let head = u64::from_str_radix(hash.get(..12).unwrap_or("0"), 16).unwrap_or(0);
    head as f64 / (1_u64 << 48) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_shares_come_out_as_they_were_asked_for() {
        let splits = Splits::parse("train=0.7,val=0.1,test=0.2").unwrap();
        let n = 10_000;
        let in_part = |name: &str| {
            (0..n).filter(|i| splits.at(fraction(&i.to_string())) == name).count() as f64
        };
        for (name, share) in [("train", 0.7), ("val", 0.1), ("test", 0.2)] {
            // Five standard deviations of a binomial.
            let spread = 5.0 * (f64::from(n) * share * (1.0 - share)).sqrt();
            assert!((in_part(name) - f64::from(n) * share).abs() < spread, "{name}");
        }
    }

    /// A session of one recorded file, and of an image where there is one.
    fn manifest(file: u64, image: Option<u64>) -> Manifest {
        let shown = image.map(|image| {
            json!({
                "name": "stimulus", "description": { "sha256": format!("{image:064x}") },
                "n_samples": 0, "n_dropped": 0, "lost": null,
            })
        });
        let recording = json!({
            "rig": "", "trajectory": "", "devices": shown.into_iter().collect::<Vec<_>>(),
            "ended": "complete", "trajectory_began_ns": null, "clocks": null,
        });
        let value = json!({
            "schema": "evrig.session/1", "name": "s", "evrig_version": "0", "created": "",
            "origin": { "kind": "recorded", "rig": "r", "trajectory": "t" },
            "status": "complete", "streams": [], "losses": [], "decisions": [],
            "files": { "davis.aedat4": { "bytes": 1, "sha256": format!("{file:064x}") } },
            "recording": recording,
        });
        serde_json::from_value(value).unwrap()
    }

    #[test]
    fn no_two_parts_share_an_image_and_a_seed_shares_out_anew() {
        let by_image = Splits::default().drawn(SplitBy::Stimulus, 0);
        let another = Splits::default().drawn(SplitBy::Stimulus, 1);
        let by_recording = Splits::default();
        let (mut n_moved, mut n_torn) = (0, 0);
        for image in 0..60 {
            let sessions: Vec<_> = (0..5).map(|i| manifest(100 * image + i, Some(image))).collect();
            let part = by_image.of(&sessions[0]);
            assert!(sessions.iter().all(|session| by_image.of(session) == part), "{image}");
            n_moved += usize::from(another.of(&sessions[0]) != part);
            let first = by_recording.of(&sessions[0]);
            n_torn += usize::from(sessions.iter().any(|s| by_recording.of(s) != first));
        }
        // Of 60 images 34 % move on average, and of recordings 66 % of five are torn apart.
        assert!((5..40).contains(&n_moved) && n_torn > 20, "{n_moved} {n_torn}");
        // Where no image is stated, a recording counts as its own.
        let alone = manifest(7, None);
        assert_eq!((stimulus(&alone), by_image.of(&alone)), (None, by_recording.of(&alone)));
    }

    #[test]
    fn shares_that_make_no_split_are_refused_by_name() {
        for (text, expected) in [
            ("train", "no `=`"),
            ("train=0.8,train=0.2", "unique name"),
            ("train=0.8,test=0.1", "add up to 0.9"),
            ("train=2,test=-1", "no share"),
            ("train=x", "no number"),
        ] {
            let error = Splits::parse(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
