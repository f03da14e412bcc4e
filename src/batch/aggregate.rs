//! Measures over the sessions of a dataset, by generator variant.
//!
//! A measure of a variant is the mean over the sessions in which it is known. Its error is that of
//! a bootstrap over sessions: sessions are what another recording day would draw anew, while the
//! blocks and tiles behind a session's own error are not. One session has no such error, and none
//! is claimed.

use super::{BatchError, FoundSession};
use crate::pipeline::{PipelineError, read_comparison};
use evrig_core::stats::{Estimate, SplitMix, median};
use evrig_session::{Session, StreamKind, StreamName};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Draws of sessions behind each error.
const N_BOOTSTRAP: usize = 2000;

/// A measure of one variant in one session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SessionValue {
    /// The session's path in the dataset.
    pub session: String,
    /// The simulated stream.
    pub variant: String,
    /// The measure.
    pub measure: String,
    /// Its value with the session's own error.
    pub estimate: Estimate,
    /// Whether it lies in the range that its authors call healthy.
    pub is_healthy: Option<bool>,
    /// Real events compared.
    pub n_real: u64,
    /// Simulated events compared.
    pub n_simulated: u64,
}

/// A measure of one variant over the sessions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeasureMean {
    /// The measure.
    pub measure: String,
    /// Its name for people.
    pub name: String,
    /// Unit of its value; "1" for a pure number.
    #[serde(default)]
    pub unit: String,
    /// Mean over the sessions, with the error of a bootstrap over them; `n` is their number.
    pub mean: Estimate,
    /// Median over the sessions.
    pub median: f64,
    /// Sessions in which it is healthy, of those with a range.
    pub n_healthy: u64,
    /// Range that its authors call healthy.
    pub healthy: Option<[f64; 2]>,
}

/// A variant: a generator on frames or a scene, by the name of the stream it makes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VariantMeans {
    /// The stream's name.
    pub name: String,
    /// Sessions that have it.
    pub n_sessions: u64,
    /// Its measures.
    pub cells: Vec<MeasureMean>,
}

/// The comparison of a dataset.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Aggregate {
    /// `evrig.dataset-comparison/1`.
    pub schema: String,
    /// The dataset.
    pub dataset: String,
    /// The rig whose sessions were taken; all where none was asked for.
    pub rig: Option<String>,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// Draws behind each error.
    pub n_bootstrap: u64,
    /// The variants in the order of their names.
    pub variants: Vec<VariantMeans>,
    /// The same session by session.
    pub sessions: Vec<SessionValue>,
    /// Sessions without a comparison, with the reason.
    pub left_out: Vec<String>,
}

/// What is fixed about a measure.
struct MeasureFacts {
    id: String,
    name: String,
    unit: String,
    healthy: Option<[f64; 2]>,
}

/// Gathers what the stage `compare` left in the sessions; a session of which nothing can be had is
/// left out with the reason.
#[must_use]
pub fn aggregate(
    dataset: &str,
    found: &[&FoundSession],
    rig: Option<&str>,
    seed: u64,
) -> Aggregate {
    let mut values = Vec::new();
    let mut facts: Vec<MeasureFacts> = Vec::new();
    let mut left_out = Vec::new();
    for one in found {
        match &one.session {
            Ok(session) => {
                let before = values.len();
                let read = of_session(&one.key, session, &mut values, &mut facts);
                if let Err(error) = read {
                    // One session's files must not cost the others their table.
                    let remedy = "run `evrig compare` on it with --force";
                    let because = one.relative(&error.to_string());
                    left_out.push(format!("{}: {because}; {remedy}", one.key));
                } else if values.len() == before {
                    left_out.push(format!("{}: no stream of it was compared", one.key));
                }
            }
            Err(error) => left_out.push(format!("{}: {error}", one.key)),
        }
    }
    let mut names: Vec<&str> = values.iter().map(|value| value.variant.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    let variants = names.into_iter().map(|name| variant(name, &values, &facts, seed)).collect();
    Aggregate {
        schema: "evrig.dataset-comparison/1".into(),
        dataset: dataset.to_owned(),
        rig: rig.map(str::to_owned),
        seed,
        n_bootstrap: N_BOOTSTRAP as u64,
        variants,
        sessions: values,
        left_out,
    }
}

fn of_session(
    key: &str,
    session: &Session,
    values: &mut Vec<SessionValue>,
    facts: &mut Vec<MeasureFacts>,
) -> Result<(), PipelineError> {
    let recorded = session.manifest().streams.iter();
    let mut names: Vec<StreamName> = recorded
        .filter(|stream| stream.kind == StreamKind::Events)
        .filter_map(|stream| StreamName::new(&stream.name).ok())
        .collect();
    names.extend(session.generated_names());
    for name in names {
        let Some(comparison) = read_comparison(session, &name)? else { continue };
        for measure in &comparison.measures {
            let id = serde_json::to_value(measure.id).unwrap_or_default();
            let id = id.as_str().unwrap_or_default().to_owned();
            if !facts.iter().any(|known| known.id == id) {
                let (name, unit) = (measure.name.to_string(), measure.unit.to_string());
                facts.push(MeasureFacts { id: id.clone(), name, unit, healthy: measure.healthy });
            }
            values.push(SessionValue {
                session: key.to_owned(),
                variant: name.to_string(),
                measure: id,
                estimate: measure.estimate,
                is_healthy: measure.is_healthy(),
                n_real: comparison.n_real,
                n_simulated: comparison.n_simulated,
            });
        }
    }
    Ok(())
}

fn variant(name: &str, values: &[SessionValue], facts: &[MeasureFacts], seed: u64) -> VariantMeans {
    let own: Vec<&SessionValue> = values.iter().filter(|value| value.variant == name).collect();
    let mut sessions: Vec<&str> = own.iter().map(|value| value.session.as_str()).collect();
    sessions.dedup();
    let cell = |facts: &MeasureFacts| {
        let of_measure = own.iter().filter(|value| value.measure == facts.id);
        let known: Vec<f64> =
            of_measure.clone().map(|v| v.estimate.value).filter(|v| v.is_finite()).collect();
        MeasureMean {
            measure: facts.id.clone(),
            name: facts.name.clone(),
            unit: facts.unit.clone(),
            mean: mean(&known, seed),
            median: median(known.iter().copied()).unwrap_or(f64::NAN),
            n_healthy: of_measure.filter(|value| value.is_healthy == Some(true)).count() as u64,
            healthy: facts.healthy,
        }
    };
    let cells = facts.iter().map(cell).collect();
    VariantMeans { name: name.to_owned(), n_sessions: sessions.len() as u64, cells }
}

/// The mean, with the spread of the means of sessions drawn anew. The plain bootstrap of a mean is
/// too narrow by a factor of sqrt((n - 1) / n), which matters for few sessions: replicates are
/// spread by it.
fn mean(values: &[f64], seed: u64) -> Estimate {
    let n = values.len();
    if n == 0 {
        return Estimate::unknown();
    }
    let mean = values.iter().sum::<f64>() / n as f64;
    if n == 1 {
        return Estimate::with_interval(mean, f64::NAN, [f64::NAN; 2], 1);
    }
    let wider = (n as f64 / (n as f64 - 1.0)).sqrt();
    let mut replicates: Vec<f64> = (0..N_BOOTSTRAP)
        .map(|i| {
            let mut random = SplitMix::new(seed, i as u64);
            let drawn = (0..n).map(|_| values[random.below(n)]).sum::<f64>() / n as f64;
            mean + wider * (drawn - mean)
        })
        .collect();
    Estimate::from_replicates(mean, &mut replicates, n as u64)
}

impl Aggregate {
    /// Writes `comparison.json`, `comparison.csv` and `comparison-sessions.csv`.
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn write(&self, root: &Path) -> Result<(), BatchError> {
        let path = root.join("comparison.json");
        let text = serde_json::to_string_pretty(self)
            .map_err(|e| BatchError::Malformed { path: path.clone(), what: e.to_string() })?;
        evrig_session::write_whole(&path, text.as_bytes())?;
        let head =
            "variant,measure,n_sessions,mean,standard_error,ci90_low,ci90_high,median,n_healthy";
        let rows = self.variants.iter().flat_map(|variant| {
            variant.cells.iter().map(|cell| {
                let Estimate { value, standard_error, ci90, n } = cell.mean;
                let numbers = [value, standard_error, ci90[0], ci90[1], cell.median].map(plain);
                let mut row = vec![variant.name.clone(), cell.measure.clone(), n.to_string()];
                row.extend(numbers);
                row.push(cell.n_healthy.to_string());
                row
            })
        });
        table(&root.join("comparison.csv"), head, rows)?;
        let head = "session,variant,measure,value,standard_error,n_real,n_simulated";
        let rows = self.sessions.iter().map(|row| {
            let [value, error] = [row.estimate.value, row.estimate.standard_error].map(plain);
            let SessionValue { session, variant, measure, n_real, n_simulated, .. } = row;
            let names = [session, variant, measure].map(String::clone);
            let counts = [n_real, n_simulated].map(u64::to_string);
            names.into_iter().chain([value, error]).chain(counts).collect()
        });
        table(&root.join("comparison-sessions.csv"), head, rows)
    }
}

fn table(
    path: &Path,
    head: &str,
    rows: impl Iterator<Item = Vec<String>>,
) -> Result<(), BatchError> {
    write_csv(path, std::iter::once(head.split(',').map(str::to_owned).collect()).chain(rows))
}

/// Writes rows of fields as CSV, whole or not at all.
pub(super) fn write_csv(
    path: &Path,
    rows: impl Iterator<Item = Vec<String>>,
) -> Result<(), BatchError> {
    let failed = |error: std::io::Error| BatchError::io(path)(error);
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.write_record(&row).map_err(|error| failed(error.into()))?;
    }
    let bytes = writer.into_inner().map_err(|error| failed(error.into_error()))?;
    Ok(evrig_session::write_whole(path, &bytes)?)
}

/// A number as it is, or nothing where it is not known.
pub(super) fn plain(value: f64) -> String {
    if value.is_finite() { value.to_string() } else { String::new() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::stats::Moments;

    #[test]
    fn the_error_of_a_mean_over_sessions_is_what_repeating_them_shows() {
        // The truth is planted: a hundred datasets of eight sessions each, sd 2 about 10.
        let (n, sd) = (8, 2.0);
        let mut n_covered = 0;
        let mut errors = Moments::default();
        for trial in 0..200 {
            let mut random = SplitMix::new(5, trial);
            let values: Vec<f64> = (0..n).map(|_| 10.0 + sd * random.normal()).collect();
            let found = mean(&values, 1);
            n_covered += usize::from(found.covers(10.0));
            errors.push(found.standard_error);
        }
        let expected = sd / (n as f64).sqrt();
        assert!((errors.mean() / expected - 1.0).abs() < 0.08, "{} {expected}", errors.mean());
        // Percentiles of eight are a little narrow: 90 % nominal, 85 % and more in truth.
        assert!((162..=196).contains(&n_covered), "{n_covered} of 200");
    }

    #[test]
    fn one_session_has_no_error_and_none_is_made_up() {
        let one = mean(&[1.5], 0);
        assert_eq!((one.value, one.n), (1.5, 1));
        assert!(one.standard_error.is_nan());
        assert!(mean(&[], 0).value.is_nan());
    }
}
