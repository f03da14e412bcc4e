//! The commands in groups, as `evrig --help` lists them.

use super::Cli;
use clap::CommandFactory;
use std::fmt::Write;

/// Groups with their commands, in the order in which a user meets them.
const GROUPS: [(&str, &[&str]); 6] = [
    ("Simulate", &["demo", "prove", "emulate"]),
    ("Record", &["check", "plan", "record", "live", "stimulus", "pi", "pair"]),
    ("Prepare", &["import", "info", "verify", "sync", "track", "scene", "filter", "process"]),
    ("Generate and compare", &["generate", "calibrate", "compare", "sweep"]),
    ("Explain", &["diagnose", "camera-report", "export-camera", "report"]),
    ("Share", &["export", "completions", "man"]),
];

/// The program's command line with its commands in groups.
#[must_use]
pub fn command() -> clap::Command {
    let command = Cli::command();
    let mut groups = String::new();
    for (group, names) in GROUPS {
        let _ = writeln!(groups, "{group}:");
        for name in names {
            let about = command.find_subcommand(name).and_then(clap::Command::get_about);
            let about = about.map(ToString::to_string).unwrap_or_default();
            let _ = writeln!(groups, "  {name:<14} {}", about.replace('\n', " "));
        }
        groups.push('\n');
    }
    let mut options = String::new();
    for option in command.get_arguments().filter(|option| option.get_long().is_some()) {
        let short = option.get_short().map_or_else(|| "   ".into(), |short| format!("-{short},"));
        let long = option.get_long().unwrap_or_default();
        let help = option.get_help().map(ToString::to_string).unwrap_or_default();
        let _ = writeln!(options, "  {short} --{long:<10} {help}");
    }
    options += "  -h, --help       Print help; -h the options in general use\n";
    options += "  -V, --version    Print the version\n";
    command.help_template(format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{groups}\
         Options of every command:\n{}{{after-help}}",
        options.trim_end()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_is_in_one_group() {
        let command = Cli::command();
        let visible = command.get_subcommands().filter(|command| !command.is_hide_set());
        let mut all: Vec<&str> = visible.map(clap::Command::get_name).collect();
        let mut grouped: Vec<&str> =
            GROUPS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        all.sort_unstable();
        grouped.sort_unstable();
        assert_eq!(grouped, all);
    }

    #[test]
    fn the_help_lists_options_once_and_every_short_help_fits_a_screen() {
        let mut command = command();
        let help = command.render_help().to_string();
        assert_eq!(help.matches("--quiet").count(), 1, "{help}");
        for subcommand in command.get_subcommands_mut() {
            let lines = subcommand.render_help().to_string().lines().count();
            assert!(lines <= 60, "{} has {lines} lines", subcommand.get_name());
        }
    }
}
