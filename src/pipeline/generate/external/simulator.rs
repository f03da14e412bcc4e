//! A simulator of other software, as a list of variants describes it.

use super::work_folder::WorkFolder;
use crate::pipeline::PipelineError;
use evrig_generate::input::FramePreparation;
use evrig_session::import::EventTableOptions;
use evrig_session::{Sha256Hex, sha256_of_file};
use serde::Deserialize;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Deadline by default: a quarter of the default time limit of a Slurm task (4 h), so that a task
/// with one simulator that hangs still ends with its other results.
const DEFAULT_DEADLINE_S: u64 = 3600;

/// A command that makes events of frames, and how its output is read.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExternalSimulator {
    /// Name of the stream to make.
    pub name: String,
    /// Name of the frame stream.
    pub from: String,
    /// Program and arguments, with placeholders such as `{frames}`. No shell interprets it.
    pub command: String,
    /// Seconds until it is killed.
    pub deadline_s: Option<u64>,
    /// Files beside those in the command whose content changes the events.
    #[serde(default)]
    pub inputs: Vec<String>,
    /// The event file in the folder `{out}`, where several are written.
    pub output: Option<String>,
    /// Unit of the output's times: s, ms, us or ns.
    pub time_unit: Option<String>,
    /// Order of the output's columns, as txyp.
    pub columns: Option<String>,
    /// Values of ON and OFF in the output, as 1,0.
    pub polarity: Option<String>,
    /// Channel of raw frames.
    pub colour: Option<String>,
    /// Whether the stated black level is subtracted.
    #[serde(default)]
    pub subtract_black: bool,
    /// Value of `{seed}`.
    pub seed: Option<u64>,
}

/// Placeholders of a command.
const PLACEHOLDERS: [&str; 7] = ["frames", "times", "out", "fps", "width", "height", "seed"];

/// A command whose files are known.
#[derive(Debug)]
pub(super) struct ResolvedCommand {
    /// Words with placeholders; files are absolute paths.
    words: Vec<String>,
    /// Checksums by the name in the list.
    files: BTreeMap<String, Sha256Hex>,
}

impl ExternalSimulator {
    pub(super) fn deadline(&self) -> Duration {
        Duration::from_secs(self.deadline_s.unwrap_or(DEFAULT_DEADLINE_S))
    }

    /// Splits the command into words. A word that names a file in `folder`, that of the list, is
    /// the path of that file; the program is searched for in PATH unless it holds a `/`.
    ///
    /// # Errors
    /// [`PipelineError::Request`] when the command cannot be split, has an unknown placeholder or
    /// no `{out}`, or an input does not exist.
    pub(super) fn resolve(&self, folder: &Path) -> Result<ResolvedCommand, PipelineError> {
        let wrong =
            |what: String| PipelineError::Request(format!("variant `{}`: {what}", self.name));
        let mut words = shlex::split(&self.command)
            .filter(|words| !words.is_empty())
            .ok_or_else(|| wrong(format!("`{}` is no command; check its quotes", self.command)))?;
        if let Some(name) = words.iter().find_map(|word| unknown_placeholder(word)) {
            let known = PLACEHOLDERS.map(|name| format!("{{{name}}}")).join(", ");
            return Err(wrong(format!("unknown placeholder {{{name}}}; known are {known}")));
        }
        if !words.iter().any(|word| word.contains("{out}")) {
            return Err(wrong("the command has no {out}, the file or folder to write".into()));
        }
        let mut files = BTreeMap::new();
        let mut take = |name: &str, path: &Path| -> Result<(), PipelineError> {
            files.insert(name.to_owned(), sha256_of_file(path)?.0);
            Ok(())
        };
        for (i, word) in words.iter_mut().enumerate() {
            let path = folder.join(&*word);
            if (i > 0 || word.contains('/')) && path.is_file() {
                take(word, &path)?;
                *word = path.display().to_string();
            }
        }
        for name in &self.inputs {
            let path = folder.join(name);
            if !path.is_file() {
                return Err(wrong(format!("the input {} is no file", path.display())));
            }
            take(name, &path)?;
        }
        Ok(ResolvedCommand { words, files })
    }

    /// How the output is read.
    ///
    /// # Errors
    /// [`PipelineError::Request`] when a key has no such value.
    pub(super) fn table_options(&self) -> Result<EventTableOptions, PipelineError> {
        Ok(EventTableOptions {
            time_unit: self.parse("time_unit", self.time_unit.as_deref())?,
            columns: self.parse("columns", self.columns.as_deref())?,
            polarity: self.parse("polarity", self.polarity.as_deref())?,
            ..EventTableOptions::default()
        })
    }

    /// What is done to the frames before the command gets them.
    ///
    /// # Errors
    /// [`PipelineError::Request`] when there is no such colour.
    pub(super) fn preparation(&self) -> Result<FramePreparation, PipelineError> {
        let colour = self.parse("colour", self.colour.as_deref())?.unwrap_or_default();
        let subtract_black = self.subtract_black;
        Ok(FramePreparation { colour, subtract_black, ..FramePreparation::default() })
    }

    fn parse<T: std::str::FromStr<Err: std::fmt::Display>>(
        &self,
        key: &str,
        value: Option<&str>,
    ) -> Result<Option<T>, PipelineError> {
        let wrong =
            |error| PipelineError::Request(format!("variant `{}`, key {key}: {error}", self.name));
        value.map(|value| value.parse().map_err(wrong)).transpose()
    }

    /// Everything that the events depend on beside the frames.
    pub(super) fn parameters(&self, command: &ResolvedCommand, seed: u64) -> serde_json::Value {
        json!({
            "from": self.from,
            "command": self.command,
            "files": command.files,
            "seed": seed,
            "output": self.output,
            "time_unit": self.time_unit,
            "columns": self.columns,
            "polarity": self.polarity,
            "colour": self.colour,
            "subtract_black": self.subtract_black,
        })
    }
}

impl ResolvedCommand {
    /// The words with the values of a work folder for the placeholders.
    pub(super) fn words(&self, work: &WorkFolder, seed: u64) -> Vec<String> {
        let path = |path: PathBuf| path.display().to_string();
        let values = [
            path(work.frames()),
            path(work.times()),
            path(work.out()),
            work.frames_per_s().to_string(),
            work.size.width.to_string(),
            work.size.height.to_string(),
            seed.to_string(),
        ];
        let fill = |word: &String| {
            let named = PLACEHOLDERS.iter().zip(&values);
            named.fold(word.clone(), |word, (name, value)| {
                word.replace(&format!("{{{name}}}"), value)
            })
        };
        self.words.iter().map(fill).collect()
    }
}

/// A name in braces that is no placeholder.
fn unknown_placeholder(word: &str) -> Option<&str> {
    let names = word.split('{').skip(1).filter_map(|rest| Some(rest.split_once('}')?.0));
    let is_name = |name: &&str| !name.is_empty() && name.chars().all(|c| c.is_ascii_lowercase());
    names.filter(is_name).find(|name| !PLACEHOLDERS.contains(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resolve(command: &str, folder: &Path) -> Result<ResolvedCommand, String> {
        let table = format!("name = \"n\"\nfrom = \"frames\"\ncommand = '''{command}'''");
        let simulator: ExternalSimulator = toml::from_str(&table).unwrap();
        simulator.resolve(folder).map_err(|error| error.to_string())
    }

    #[test]
    fn a_script_beside_the_list_is_found_and_its_content_counts() {
        let folder = tempfile::tempdir().unwrap();
        let script = folder.path().join("my sim.py");
        std::fs::write(&script, "one").unwrap();
        std::fs::write(folder.path().join("python"), "not the program").unwrap();
        let command = "python 'my sim.py' --size {width}x{height} {out}.npz";
        let first = resolve(command, folder.path()).unwrap();
        assert_eq!(first.words[..2], ["python", script.to_str().unwrap()]);
        std::fs::write(&script, "two").unwrap();
        let second = resolve(command, folder.path()).unwrap();
        assert_ne!(first.files["my sim.py"], second.files["my sim.py"]);
    }

    #[test]
    fn a_command_that_cannot_be_run_is_refused_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        for (command, reason) in [
            ("sim 'unbalanced {out}", "check its quotes"),
            ("sim {frame} {out}", "unknown placeholder {frame}"),
            ("sim {frames} {times}", "no {out}"),
        ] {
            let message = resolve(command, folder.path()).unwrap_err();
            assert!(message.contains(reason), "{message}");
        }
        assert!(resolve("sim '{\"a\": 1}' {out}", folder.path()).is_ok());
    }
}
