//! Helps that name the formats of meshes: `{meshes}` stands for those of the table.

use chpm_import::read_formats;
use clap::builder::StyledStr;
use clap::{Arg, Command};

/// Stands in helps for the formats that are read.
const PLACE: &str = "{meshes}";

/// Puts the formats into the helps of a command, of its arguments and of its verbs.
pub(crate) fn named(command: Command) -> Command {
    let (about, long) = (help_text(command.get_about()), help_text(command.get_long_about()));
    let command = command.mut_args(argument).mut_subcommands(named);
    let command = about.into_iter().fold(command, Command::about);
    long.into_iter().fold(command, Command::long_about)
}

fn argument(argument: Arg) -> Arg {
    let (help, long) = (help_text(argument.get_help()), help_text(argument.get_long_help()));
    let argument = help.into_iter().fold(argument, Arg::help);
    long.into_iter().fold(argument, Arg::long_help)
}

/// A help with the formats in it, if it names them.
fn help_text(help: Option<&StyledStr>) -> Option<String> {
    let help = help?.to_string();
    help.contains(PLACE).then(|| help.replace(PLACE, &read_formats()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_help_names_every_format() {
        let argument = Arg::new("mesh").help("A mesh ({meshes})").long_help("Long: {meshes}");
        let verb = Command::new("build").about("Build {meshes}").arg(argument);
        let mut command = named(Command::new("chpm").subcommand(verb));
        command.build();
        let mut verb = command.find_subcommand("build").expect("a verb").clone();
        for help in [command.render_help(), verb.render_help(), verb.render_long_help()] {
            // Lines are broken where a terminal ends.
            let words: Vec<String> = help.to_string().split_whitespace().map(str::to_owned).collect();
            assert!(words.join(" ").contains(&read_formats()), "{help}");
        }
    }
}
