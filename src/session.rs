//! The folder of the session, which a layer of Mesa's Vulkan looks for.

use crate::cli::Command as Verb;
use chpm_extmem::platform::replace_process;
use std::env;
use std::process::Command;

const NAME: &str = "XDG_RUNTIME_DIR";

/// Begins this program anew with such a folder, where a verb draws and the environment names none: the layer would call that an error, and
/// nothing is wrong. Comes back where there is nothing to do, or where it cannot be done.
pub(crate) fn ensure_folder(verb: &Verb) {
    let draws = match verb {
        Verb::Render(_) | Verb::View(_) => true,
        Verb::Walk(args) => args.pictures.render,
        _ => false,
    };
    if !draws || env::var_os(NAME).is_some_and(|folder| !folder.is_empty()) {
        return;
    }
    if let Ok(program) = env::current_exe() {
        let mut words = env::args_os();
        let own_name = words.next().unwrap_or_default();
        let mut command = Command::new(program);
        // What it answers is why it failed: then there is a message too much.
        let _ = replace_process(command.args(words).env(NAME, env::temp_dir()), &own_name);
    }
}
