//! `chpm completions` and `chpm man`: the command line for shells and for `man`.

use super::{Verdict, stdout};
use crate::examples;
use crate::output;
use anyhow::{Context, Result};
use chpm_extmem::AtomicFile;
use chpm_mesh::Counted;
use clap::{Arg, Command};
use clap_complete::Shell;
use clap_mangen::Man;
use std::fs;
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `chpm completions`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

/// Arguments of `chpm man`.
#[derive(clap::Args, Debug)]
pub(crate) struct ManArgs {
    /// The folder of the pages; made if it is not there
    folder: PathBuf,
    /// Replace pages that exist
    #[arg(short, long)]
    force: bool,
}

/// Writes the script to stdout.
pub(crate) fn run(args: &Args) -> Result<Verdict> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut shown(), "chpm", &mut script);
    let mut out = stdout();
    out.write_all(&script)?;
    out.flush()?;
    Ok(Verdict::Good)
}

/// The command line without what help does not show: scripts would offer it.
fn shown() -> Command {
    let all = examples::command();
    let verbs = all.get_subcommands().filter(|verb| !verb.is_hide_set()).cloned();
    Command::new("chpm")
        .version(env!("CARGO_PKG_VERSION"))
        .args(all.get_arguments().cloned())
        .subcommands(verbs)
}

/// How a verb is called: what may be left out, what has to be there, and the files, each option with what it takes.
fn synopsis(verb: &Command) -> String {
    fn long(arg: &Arg) -> String {
        arg.get_long().map_or(String::new(), |long| format!("--{long}{}", value(arg)))
    }
    let groups: Vec<Vec<&Arg>> = verb
        .get_groups()
        .filter(|group| group.is_required_set())
        .map(|group| {
            group.get_args().filter_map(|id| verb.get_arguments().find(|arg| arg.get_id() == id)).collect()
        })
        .collect();
    fn in_group(arg: &&Arg, groups: &[Vec<&Arg>]) -> bool {
        groups.iter().flatten().any(|other| other.get_id() == arg.get_id())
    }

    let shown = verb.get_arguments().filter(|arg| !arg.is_hide_set() && !in_group(arg, &groups));
    let (mut may, mut must, mut files) = (Vec::new(), Vec::new(), Vec::new());
    for arg in shown {
        let named = match (arg.is_positional(), arg.get_short()) {
            (true, _) => value(arg).trim_start().to_owned(),
            (_, Some(short)) => format!("-{short}|{}", long(arg)),
            (_, None) => long(arg),
        };
        match (arg.is_positional(), arg.is_required_set()) {
            (true, true) => files.push(named),
            (true, false) => files.push(format!("[{named}]")),
            (false, true) => must.push(named),
            (false, false) => may.push(format!("[{named}]")),
        }
    }

    must.extend(groups.iter().map(|group| {
        let options = group.iter().filter(|arg| !arg.is_hide_set()).map(|arg| match arg.is_positional() {
            true => value(arg).trim_start().to_owned(),
            false => long(arg),
        });
        format!("<{}>", options.collect::<Vec<_>>().join("|"))
    }));
    let name = verb.get_bin_name().unwrap_or(verb.get_name()).to_owned();
    [vec![name], may, must, files].concat().join(" ")
}

fn value(arg: &Arg) -> String {
    let names = arg.get_value_names().filter(|_| arg.get_action().takes_values());
    names.map_or(String::new(), |names| format!(" {}", names.join(" ")))
}

/// Writes a page for the command and one for each verb.
pub(crate) fn man(args: &ManArgs) -> Result<Verdict> {
    output::check_folder("man", &args.folder)?;
    fs::create_dir_all(&args.folder)
        .with_context(|| format!("cannot make the folder '{}'", args.folder.display()))?;
    let mut command = examples::command();
    command.build();
    let verbs = command.get_subcommands().filter(|verb| !verb.is_hide_set() && verb.get_name() != "help");
    fn page(verb: &Command) -> Man {
        Man::new(verb.clone().override_usage(synopsis(verb)))
    }
    let pages: Vec<Man> = std::iter::once(Man::new(command.clone())).chain(verbs.map(page)).collect();
    for page in &pages {
        let mut file = AtomicFile::create(&args.folder.join(page.get_filename()), args.force)?;
        page.render(&mut file)?;
        file.publish()?;
    }
    let mut out = stdout();
    writeln!(out, "{}: {}", args.folder.display(), Counted(pages.len() as u64, "page"))?;
    out.flush()?;
    Ok(Verdict::Good)
}
