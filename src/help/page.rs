//! The pages of the documentation that follow from the command line. `CHPM_GOLDEN=write` writes them anew.

use super::{GROUPS, about};
use crate::examples;
use clap::{Arg, Command};
use std::fmt::Write;
use std::path::PathBuf;
use std::{env, fs};

const START: &str = "<!-- verbs: generated from the command line -->\n";
const END: &str = "<!-- end of verbs -->\n";

/// The verbs of the list, in its order.
fn verbs(command: &Command) -> impl Iterator<Item = (&'static str, Vec<&Command>)> {
    GROUPS
        .map(|(group, verbs)| {
            (group, verbs.iter().filter_map(|verb| command.find_subcommand(verb)).collect())
        })
        .into_iter()
}

/// The table of the manual.
fn table(command: &Command) -> String {
    let mut page = "| | verb | does |\n|---|---|---|\n".to_owned();
    for (group, verbs) in verbs(command) {
        let group = std::iter::once(group).chain(std::iter::repeat(""));
        for (group, verb) in group.zip(verbs.iter().filter(|verb| verb.get_name() != "help")) {
            let name = verb.get_name();
            let does = about(command, name).unwrap_or_default();
            let _ = writeln!(page, "| {group} | [`{name}`](VERBS.md#chpm-{name}) | {} |", escaped(&does));
        }
    }
    page
}

/// Text that is no table and no element of HTML.
fn escaped(text: &str) -> String {
    text.replace('|', "\\|").replace('<', "&lt;")
}

/// A paragraph in one line.
fn line(paragraph: &str) -> String {
    paragraph.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// A row about an argument.
fn row(arg: &Arg) -> String {
    let values = arg.get_value_names().filter(|_| arg.get_action().takes_values());
    let value = values.map_or(String::new(), |names| format!(" {}", names.join(" ")));
    let name = match (arg.get_long(), arg.get_short()) {
        (Some(long), Some(short)) => format!("-{short}, --{long}{value}"),
        (Some(long), None) => format!("--{long}{value}"),
        _ => value.trim_start().to_owned(),
    };
    let mut text = arg.get_long_help().or(arg.get_help()).map(ToString::to_string).unwrap_or_default();
    text = text.split("\n\n").map(line).collect::<Vec<_>>().join(". ");
    if arg.get_action().takes_values() {
        let shown = arg.get_possible_values().into_iter().filter(|value| !value.is_hide_set());
        for value in shown {
            let help = value.get_help().map_or(String::new(), |help| format!(": {help}"));
            let _ = write!(text, "<br>`{}`{}", value.get_name(), escaped(&help.to_string()));
        }
        let defaults = arg.get_default_values().iter().map(|value| value.to_string_lossy());
        let defaults: Vec<_> = defaults.collect();
        if !defaults.is_empty() {
            let _ = write!(text, "<br>(`{}` if not given)", defaults.join(" "));
        }
    }
    format!("| `{}` | {} |\n", name.replace('|', "\\|"), text.replace('|', "\\|"))
}

/// Whether an argument decides the bytes of a model, as those of `build` do.
fn is_setting(arg: &Arg) -> bool {
    arg.get_help_heading().is_some_and(|heading| heading.starts_with("Settings"))
}

/// The page of all verbs with all that they take.
fn reference(command: &Command) -> String {
    let mut page = "# Verbs\n\nEvery verb with all that it takes, as `chpm help VERB` prints it. Generated from the program: a test \
                    compares this page, and `CHPM_GOLDEN=write cargo test -p chpm help::page` writes it anew.\n"
        .to_owned();
    for (group, verbs) in verbs(command) {
        let _ = write!(page, "\n## {group}\n");
        for verb in verbs.iter().filter(|verb| verb.get_name() != "help") {
            let about =
                verb.get_long_about().or(verb.get_about()).map(ToString::to_string).unwrap_or_default();
            let _ = write!(page, "\n### chpm {}\n\n{}.\n\n", verb.get_name(), about.trim_end_matches('.'));
            page += "| | |\n|---|---|\n";
            let shown = verb.get_arguments().filter(|arg| !arg.is_hide_set() && arg.get_id() != "help");
            shown.for_each(|arg| page += &row(arg));
            for step in verb.get_subcommands().filter(|step| step.get_name() != "help") {
                let about = step.get_about().map(ToString::to_string).unwrap_or_default();
                let _ = writeln!(page, "| **`{}`** | **{}** |", step.get_name(), escaped(&about));
                let shown = step.get_arguments().filter(|arg| !arg.is_hide_set() && arg.get_id() != "help");
                // Settings are those of the build.
                let own = shown.filter(|arg| !is_setting(arg));
                own.for_each(|arg| page += &row(arg));
            }
            let examples = verb.get_after_long_help().map(ToString::to_string).unwrap_or_default();
            let examples = examples.trim_start_matches("Examples:\n").replace("\n  ", "\n");
            let _ = write!(page, "\n```sh\n{}\n```\n", examples.trim());
        }
    }
    page
}

/// A file of the repository.
fn path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(name)
}

/// Compares a page with what it has to be, or writes it.
fn compare(name: &str, expected: &str) {
    if env::var_os("CHPM_GOLDEN").is_some_and(|word| word == "write") {
        fs::write(path(name), expected).expect("a page");
    }
    let found = fs::read_to_string(path(name)).unwrap_or_default();
    assert!(found == expected, "{name} is stale: run CHPM_GOLDEN=write cargo test -p chpm help::page");
}

#[test]
fn the_page_of_verbs_is_current() {
    let mut command = examples::command();
    command.build();
    compare("docs/VERBS.md", &reference(&command));
}

#[test]
fn the_table_of_the_manual_is_current() {
    let mut command = examples::command();
    command.build();
    let manual = fs::read_to_string(path("docs/MANUAL.md")).expect("the manual");
    let (before, rest) = manual.split_once(START).expect("where the table begins");
    let (_, after) = rest.split_once(END).expect("where the table ends");
    compare("docs/MANUAL.md", &[before, START, &table(&command), END, after].concat());
}
