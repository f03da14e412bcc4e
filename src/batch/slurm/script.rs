//! The scripts of tasks and gathering job.

use super::SlurmJob;
use std::path::Path;

/// A task: one session, by its number behind the number of the array's first.
pub(super) fn tasks(program: &Path, root: &Path, job: &SlurmJob) -> String {
    let command = command(program, root, job);
    format!(
        "#!/bin/sh\n\
         # A session a task. Its number in the list is that of the array's first, then its own.\n\
         export RAYON_NUM_THREADS=\"${{SLURM_CPUS_PER_TASK:-1}}\"\n\
         exec {command} --task \"$(( $1 + SLURM_ARRAY_TASK_ID ))\"\n"
    )
}

/// The job behind the tasks: index, card, comparison, report; and what was cut off once more.
pub(super) fn gather(program: &Path, root: &Path, job: &SlurmJob) -> String {
    let command = command(program, root, job);
    format!(
        "#!/bin/sh\n\
         export RAYON_NUM_THREADS=\"${{SLURM_CPUS_PER_TASK:-1}}\"\n\
         exec {command} --gather\n"
    )
}

fn command(program: &Path, root: &Path, job: &SlurmJob) -> String {
    let mut words = vec![program.display().to_string(), "process".to_owned()];
    words.push(root.display().to_string());
    words.extend(job.arguments.iter().cloned());
    words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ")
}

/// A word that the shell takes as it is.
fn quoted(word: &str) -> String {
    format!("'{}'", word.replace('\'', "'\\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_name_of_a_folder_becomes_a_command() {
        for hostile in ["a b", "it's", "$(touch x)", "`touch x`; rm -rf *", "\"", "-n"] {
            let output = std::process::Command::new("sh")
                .args(["-c", &format!("printf %s {}", quoted(hostile))])
                .output()
                .unwrap();
            assert_eq!(String::from_utf8(output.stdout).unwrap(), hostile);
        }
    }
}
