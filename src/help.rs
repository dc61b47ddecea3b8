//! The verbs by what they are for, as `chpm --help` and the manual list them.

use clap::builder::Styles;
use clap::{Command, builder::StyledStr};
use std::fmt::Write;

/// Verbs that belong together, in the order in which they are listed.
const GROUPS: [(&str, &[&str]); 7] = [
    ("Make", &["build", "simplify", "batch", "stage", "work", "relayout", "synth"]),
    ("Look", &["view", "render", "info", "stats", "report", "dump"]),
    ("Check", &["verify", "measure", "bench"]),
    ("Compare", &["compare", "distance", "clearance", "contacts"]),
    ("Probe", &["rays", "thickness", "visible"]),
    ("Share", &["extract", "section", "export", "serve", "share"]),
    ("Tools", &["demo", "config", "path", "walk", "completions", "man", "help"]),
];

/// The command with its verbs listed by group.
pub(crate) fn grouped(command: Command) -> Command {
    let header = *Styles::default().get_header();
    let mut list = String::new();
    for (group, verbs) in GROUPS {
        let _ = writeln!(list, "{header}{group}:{header:#}");
        for verb in verbs {
            if let Some(does) = about(&command, verb) {
                let _ = writeln!(list, "  {verb:<12} {does}");
            }
        }
    }
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{list}\n{header}Options:{header:#}\n{{options}}{{after-help}}"
    );
    command.help_template(StyledStr::from(template))
}

/// A line about a verb; none if it is not compiled in.
fn about(command: &Command, verb: &str) -> Option<String> {
    if verb == "help" {
        return Some("Print this, or all that a verb takes: chpm help build".to_owned());
    }
    Some(command.find_subcommand(verb)?.get_about()?.to_string())
}

#[cfg(all(test, feature = "viewer", feature = "web"))]
mod page;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Cli;
    use clap::CommandFactory;

    #[test]
    fn each_verb_is_in_one_group() {
        let command = Cli::command();
        for verb in command.get_subcommands().filter(|verb| !verb.is_hide_set()) {
            let groups = GROUPS.iter().filter(|(_, verbs)| verbs.contains(&verb.get_name()));
            assert_eq!(groups.count(), 1, "{}", verb.get_name());
        }
    }

    #[test]
    fn the_list_of_verbs_fits_eighty_columns() {
        let help = grouped(Cli::command()).term_width(80).render_help().to_string();
        assert!(help.lines().all(|line| line.chars().count() <= 80), "{help}");
        assert!(help.contains("Make:\n  build"), "{help}");
    }

    #[test]
    fn the_short_help_of_build_fits_a_screen() {
        let mut command = Cli::command().term_width(80);
        let build = command.find_subcommand_mut("build").expect("the verb");
        let help = build.clone().term_width(80).render_help().to_string();
        assert!(help.lines().count() <= 40, "{}:\n{help}", help.lines().count());
    }
}
