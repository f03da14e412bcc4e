//! `journal.jsonl`: what happened, when; appended and synced, never rewritten.

use super::SessionError;
use chrono::{SecondsFormat, Utc};
use serde_json::{Map, Value, json};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// An open journal.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
}

impl Journal {
    /// Opens or creates a journal and locks it against other processes.
    ///
    /// A truncated last line is terminated, so that the next one is a line of its own.
    ///
    /// # Errors
    /// When the file cannot be opened, or another process has it.
    pub fn open(path: &Path) -> Result<Self, SessionError> {
        let mut file = OpenOptions::new()
            .append(true)
            .read(true)
            .create(true)
            .open(path)
            .map_err(SessionError::io(path))?;
        // A file system without locks excludes no other process.
        if let Err(TryLockError::WouldBlock) = file.try_lock() {
            return Err(SessionError::Busy { path: path.to_owned() });
        }
        end_cut_line(&mut file).map_err(SessionError::io(path))?;
        Ok(Self { path: path.to_owned(), file })
    }

    /// Writes one line, `{"at": <RFC 3339>, "what": ..., ...details}`, and syncs it to the disk.
    ///
    /// # Errors
    /// When writing fails.
    pub fn note(&mut self, what: &str, details: &Value) -> Result<(), SessionError> {
        let mut entry = Map::new();
        let now = Utc::now().to_rfc3339_opts(SecondsFormat::Micros, true);
        entry.insert("at".into(), now.into());
        entry.insert("what".into(), what.into());
        if let Value::Object(details) = details {
            entry.extend(details.clone());
        }
        let line = format!("{}\n", json!(entry));
        self.file
            .write_all(line.as_bytes())
            .and_then(|()| self.file.sync_data())
            .map_err(SessionError::io(&self.path))
    }
}

fn end_cut_line(file: &mut File) -> std::io::Result<()> {
    if file.seek(SeekFrom::End(0))? == 0 {
        return Ok(());
    }
    file.seek(SeekFrom::End(-1))?;
    let mut last = [0];
    file.read_exact(&mut last)?;
    if last == *b"\n" { Ok(()) } else { file.write_all(b"\n") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_journal_is_continued_where_it_ended() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("journal.jsonl");
        Journal::open(&path).unwrap().note("begin", &json!({"n": 1})).unwrap();
        Journal::open(&path).unwrap().note("end", &Value::Null).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<Value> =
            text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(lines.len(), 2);
        assert_eq!(lines[0]["n"], 1);
        assert_eq!(lines[1]["what"], "end");
    }
}
