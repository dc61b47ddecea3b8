//! The page's modules as one script, so that a page takes one request: each is a function of its own, in the order in which they need one another.

use super::FILES;
use std::fmt::Write;

/// The module that starts the page.
const START: &str = "view/main.js";

/// The script.
pub(crate) fn script() -> String {
    let (mut done, mut text) = (Vec::new(), String::new());
    add(START, &mut done, &mut text);
    // Where HTML would see its end.
    text.replace("</script", "<\\/script")
}

/// Writes a module, behind those that it imports.
fn add(path: &'static str, done: &mut Vec<&'static str>, text: &mut String) {
    let Some(file) = FILES.iter().find(|file| file.path == path).filter(|_| !done.contains(&path)) else {
        return;
    };
    done.push(path);
    let module = Module::of(file.path, file.text);
    for (from, _) in module.imports.iter().chain(&module.passed_on) {
        add(from, done, text);
    }
    let name = variable(path);
    let _ = writeln!(text, "// {path}\nconst {name} = (() => {{");
    for (from, names) in &module.imports {
        let _ = writeln!(text, "const {{ {} }} = {};", names.replace(" as ", ": "), variable(from));
    }
    text.push_str(&module.body);
    let own = module.exports.iter().map(|name| (*name).to_owned());
    let passed_on = module.passed_on.iter().flat_map(|(from, names)| {
        names.split(',').map(|name| format!("{0}: {1}.{0}", name.trim(), variable(from)))
    });
    let all: Vec<String> = own.chain(passed_on).collect();
    let _ = writeln!(text, "return {{ {} }};\n}})();", all.join(", "));
}

/// The name of a module's exports in the script.
fn variable(path: &str) -> String {
    let letters = path.trim_end_matches(".js").chars();
    letters.map(|letter| if letter.is_ascii_alphanumeric() { letter } else { '_' }).collect()
}

/// A module of the page, taken apart.
#[derive(Default)]
struct Module {
    /// Modules, and the names that are taken from each.
    imports: Vec<(&'static str, String)>,
    /// The same of names that are only passed on.
    passed_on: Vec<(&'static str, String)>,
    exports: Vec<&'static str>,
    /// The rest.
    body: String,
}

impl Module {
    fn of(path: &str, text: &'static str) -> Self {
        let mut module = Module::default();
        for line in text.split_inclusive('\n') {
            if let Some((names, from)) = named(line, "import ") {
                module.imports.push((beside(path, from), names.to_owned()));
            } else if let Some((names, from)) = named(line, "export ") {
                module.passed_on.push((beside(path, from), names.to_owned()));
            } else if let Some(declared) = line.strip_prefix("export ") {
                module.exports.extend(declared_by(declared));
                module.body.push_str(declared);
            } else {
                module.body.push_str(line);
            }
        }
        module
    }
}

/// Names and place of `import { a, b } from "./c.js";`, which is on one line in all of our modules.
fn named<'a>(line: &'a str, word: &str) -> Option<(&'a str, &'a str)> {
    let (names, from) = line.strip_prefix(word)?.strip_prefix("{ ")?.split_once(" } from \"")?;
    Some((names, from.trim_end().strip_suffix("\";")?))
}

/// The name of a function, a class or a constant.
fn declared_by(declaration: &str) -> Option<&str> {
    let rest = declaration.strip_prefix("async ").unwrap_or(declaration);
    let rest = ["function ", "class ", "const "].iter().find_map(|kind| rest.strip_prefix(kind))?;
    rest.split(|letter: char| !letter.is_ascii_alphanumeric() && !"_$".contains(letter)).next()
}

/// The path of a module that one names by the way from it.
fn beside(path: &str, way: &str) -> &'static str {
    let mut parts: Vec<&str> = path.split('/').collect();
    parts.pop();
    for part in way.split('/') {
        match part {
            "." => {}
            ".." => {
                parts.pop();
            }
            part => parts.push(part),
        }
    }
    let found = parts.join("/");
    FILES.iter().find(|file| file.path == found).map_or("", |file| file.path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_that_modules_say_of_one_another_is_understood() {
        for file in FILES.iter().filter(|file| file.path.ends_with(".js")) {
            let module = Module::of(file.path, file.text);
            for (from, names) in module.imports.iter().chain(&module.passed_on) {
                let exports = FILES.iter().find(|file| file.path == *from).expect(file.path);
                let other = Module::of(exports.path, exports.text);
                for name in names.split(',').map(|name| name.split(" as ").next().unwrap_or(name).trim()) {
                    let passed_on = other.passed_on.iter().flat_map(|(_, names)| names.split(", "));
                    let all: Vec<&str> = other.exports.iter().copied().chain(passed_on).collect();
                    assert!(all.contains(&name), "{} takes {name} from {from}", file.path);
                }
            }
            assert!(module.exports.iter().all(|name| !name.is_empty()), "{}", file.path);
            for line in module.body.lines() {
                assert!(
                    !line.starts_with("import ") && !line.starts_with("export "),
                    "{}: {line}",
                    file.path
                );
            }
        }
    }

    #[test]
    fn the_script_has_each_module_once_behind_what_it_needs() {
        let script = script();
        assert!(!script.contains("</script"));
        let at = |path: &str| {
            let start = format!("// {path}\nconst ");
            assert_eq!(script.matches(&start).count(), 1, "{path}");
            script.find(&start).expect(path)
        };
        assert!(at("chpm/xxh3.js") < at("chpm/file.js") && at("chpm/file.js") < at("chpm/index.js"));
        assert!(at("chpm/index.js") < at("view/model.js") && at("view/model.js") < at(START));
    }
}
