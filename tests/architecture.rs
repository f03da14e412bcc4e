//! Rules of the source tree that the compiler does not check: no import circles between modules of
//! a crate, small files, no printing or command-line types below the commands. The dependencies
//! between the crates are in the manifests; a list here restricts them.

#![allow(clippy::expect_used, clippy::unwrap_used)]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// A file's lines before its tests.
const MAX_LINES: usize = 400;

struct Source {
    path: PathBuf,
    /// `src` of its crate.
    crate_src: PathBuf,
    /// Lines before the test module, without comments.
    code: Vec<String>,
    n_lines: usize,
}

fn crates() -> Vec<PathBuf> {
    let mut all = vec![PathBuf::from("src"), PathBuf::from("python/src")];
    all.extend(
        fs::read_dir("crates").expect("crates").map(|entry| entry.unwrap().path().join("src")),
    );
    assert!(all.len() > 10, "fewer crates found than expected");
    all
}

fn sources() -> Vec<Source> {
    let mut all = Vec::new();
    for crate_src in crates() {
        let mut files = Vec::new();
        collect(&crate_src, &mut files);
        all.extend(files.into_iter().map(|path| read(path, &crate_src)));
    }
    all
}

fn collect(directory: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(directory).expect("a source folder can be listed") {
        let path = entry.expect("a directory entry").path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

fn read(path: PathBuf, crate_src: &Path) -> Source {
    let text = fs::read_to_string(&path).expect("a source file is text");
    let before_tests: Vec<&str> =
        text.lines().take_while(|line| !line.starts_with("#[cfg(test)]")).collect();
    let n_lines = before_tests.len();
    let code = before_tests.iter().filter(|line| !line.trim_start().starts_with("//"));
    let code = code.map(|line| (*line).to_owned()).collect();
    Source { path, crate_src: crate_src.to_owned(), code, n_lines }
}

/// `a::b::c` of `crate_src/a/b/c.rs`; empty for the crate's root.
fn module(source: &Source) -> Vec<String> {
    let below = source.path.strip_prefix(&source.crate_src).expect("a source is below its crate");
    let mut names: Vec<String> =
        below.with_extension("").iter().map(|name| name.to_string_lossy().into_owned()).collect();
    if names == ["lib"] || names == ["main"] {
        names.clear();
    }
    names
}

/// Paths of `use` statements, with groups expanded.
fn used_paths(code: &[String]) -> Vec<Vec<String>> {
    let text = code.join(" ");
    let statements = text.split(';').filter_map(|statement| {
        let at = statement.rfind("use ")?;
        let is_word = at == 0 || statement[..at].ends_with([' ', '}', '{', ')']);
        is_word.then(|| statement[at + 4..].trim().to_owned())
    });
    let mut paths = Vec::new();
    for statement in statements {
        expand(&statement, &[], &mut paths);
    }
    paths.extend(inline_paths(&text));
    paths
}

/// Paths in expressions and types that start with `crate::` or `super::`.
fn inline_paths(text: &str) -> Vec<Vec<String>> {
    let is_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    let words = text.split(|c: char| !is_path(c));
    let paths = words.filter(|word| word.starts_with("crate::") || word.starts_with("super::"));
    paths
        .map(|path| path.split("::").filter(|s| !s.is_empty()).map(String::from).collect())
        .collect()
}

fn expand(tree: &str, above: &[String], paths: &mut Vec<Vec<String>>) {
    let tree = tree.trim();
    if let Some(open) = tree.find('{') {
        let mut above = above.to_vec();
        above.extend(
            tree[..open].split("::").map(str::trim).filter(|s| !s.is_empty()).map(String::from),
        );
        let inner = tree[open + 1..].trim_end().trim_end_matches('}');
        let (mut depth, mut start) = (0, 0);
        for (i, c) in inner.char_indices() {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    expand(&inner[start..i], &above, paths);
                    start = i + 1;
                }
                _ => {}
            }
        }
        expand(&inner[start..], &above, paths);
    } else if !tree.is_empty() {
        let mut path = above.to_vec();
        let tree = tree.split(" as ").next().unwrap_or(tree);
        path.extend(tree.split("::").map(|name| name.trim().to_owned()));
        paths.push(path);
    }
}

/// Modules of the same crate that `source` imports from, by the longest prefix that is a module.
fn imports(source: &Source, modules: &BTreeSet<Vec<String>>) -> BTreeSet<Vec<String>> {
    let own = module(source);
    let mut found = BTreeSet::new();
    for path in used_paths(&source.code) {
        let mut absolute = match path.first().map(String::as_str) {
            Some("crate") => path[1..].to_vec(),
            Some("super") => {
                let n_up = path.iter().take_while(|name| *name == "super").count();
                let mut base = own[..own.len().saturating_sub(n_up)].to_vec();
                base.extend_from_slice(&path[n_up..]);
                base
            }
            Some("self") => [own.clone(), path[1..].to_vec()].concat(),
            Some(_) => [own.clone(), path.clone()].concat(),
            None => continue,
        };
        let is_local = matches!(path[0].as_str(), "crate" | "super" | "self");
        while !absolute.is_empty() && !modules.contains(&absolute) {
            absolute.pop();
        }
        // A path that starts with a name is local only if that name is a module below this one.
        if !is_local && absolute.len() <= own.len() {
            continue;
        }
        if absolute != own && !absolute.is_empty() {
            found.insert(absolute);
        }
    }
    found
}

/// Groups of modules that import from each other, in either direction.
fn circles(graph: &BTreeMap<Vec<String>, BTreeSet<Vec<String>>>) -> Vec<Vec<String>> {
    let reach = |from: &Vec<String>| {
        let (mut visited, mut open) = (BTreeSet::new(), vec![from.clone()]);
        while let Some(node) = open.pop() {
            for next in graph.get(&node).into_iter().flatten() {
                if visited.insert(next.clone()) {
                    open.push(next.clone());
                }
            }
        }
        visited
    };
    let reached: BTreeMap<_, _> = graph.keys().map(|node| (node.clone(), reach(node))).collect();
    let mut groups = BTreeSet::new();
    for (node, all) in &reached {
        let mates =
            all.iter().filter(|other| reached.get(*other).is_some_and(|r| r.contains(node)));
        let group: BTreeSet<String> = mates.map(|name| name.join("::")).collect();
        if group.len() > 1 {
            groups.insert(group.into_iter().collect::<Vec<_>>());
        }
    }
    groups.into_iter().collect()
}

#[test]
fn modules_of_a_crate_import_without_circles() {
    let mut by_crate: BTreeMap<PathBuf, Vec<Source>> = BTreeMap::new();
    for source in sources() {
        by_crate.entry(source.crate_src.clone()).or_default().push(source);
    }
    let mut found = Vec::new();
    for (crate_src, sources) in &by_crate {
        let modules: BTreeSet<_> = sources.iter().map(module).collect();
        let mut graph = BTreeMap::new();
        for source in sources {
            let own = module(source);
            // A parent's use of its children and a child's use of its parent's items are one module
            // split over files; only links between siblings and across subtrees count.
            let foreign = imports(source, &modules)
                .into_iter()
                .filter(|other| !own.starts_with(other) && !other.starts_with(&own));
            graph.insert(own.clone(), foreign.collect::<BTreeSet<_>>());
        }
        for circle in circles(&graph) {
            found.push(format!("{}: {}", crate_src.display(), circle.join(", ")));
        }
    }
    assert!(found.is_empty(), "modules that import each other in a circle:\n{}", found.join("\n"));
}

/// The crates of the workspace that each one may depend on.
const MAY_USE: &[(&str, &[&str])] = &[
    ("core", &[]),
    ("format", &["core"]),
    ("session", &["core", "format"]),
    ("pi", &["core"]),
    ("record", &["core", "format", "session"]),
    ("device", &["core", "format", "session", "pi", "record"]),
    ("sim", &["core", "format", "session", "pi", "record", "device"]),
    ("generate", &["core"]),
    ("reconstruct", &["core", "session"]),
    ("analysis", &["core", "generate"]),
    ("report", &["core", "session", "reconstruct", "analysis"]),
];

#[test]
fn manifests_separate_acquisition_analysis_and_the_simulated_world() {
    for (name, allowed) in MAY_USE {
        let manifest = format!("crates/evrig-{name}/Cargo.toml");
        let manifest: toml::Table =
            toml::from_str(&fs::read_to_string(&manifest).expect("a manifest")).expect("TOML");
        let dependencies = manifest["dependencies"].as_table().expect("dependencies");
        let own = dependencies.keys().filter_map(|dependency| dependency.strip_prefix("evrig-"));
        for used in own {
            assert!(allowed.contains(&used), "evrig-{name} must not depend on evrig-{used}");
        }
    }
    // Beside them the root, and the extension module for Python, which uses the root alone.
    assert_eq!(MAY_USE.len() + 2, crates().len(), "every crate is in the list");
}

#[test]
fn printing_clap_and_anyhow_stay_in_the_commands() {
    for source in sources() {
        let top = module(&source).first().cloned().unwrap_or_default();
        let is_root = source.crate_src == Path::new("src");
        let is_program = source.path.ends_with("src/main.rs");
        let bans: &[&str] = match top.as_str() {
            "commands" if is_root => &[],
            "cli" => &["anyhow::", "println!", "eprintln!"],
            _ if is_program => &["anyhow::"],
            _ => &["anyhow::", "clap::", "println!", "eprintln!", "print!(", "dbg!("],
        };
        for line in &source.code {
            for ban in bans {
                let path = source.path.display();
                assert!(!line.contains(ban), "{path}: `{ban}` belongs to the commands: {line}");
            }
        }
    }
}

#[test]
fn files_are_small_and_well_named() {
    const VAGUE: &[&str] = &["utils", "util", "helpers", "common", "manager", "misc", "mod"];
    for source in sources() {
        let (n_lines, path) = (source.n_lines, source.path.display());
        assert!(n_lines <= MAX_LINES, "{path}: {n_lines} lines before tests, limit {MAX_LINES}");
        let stem = source.path.file_stem().expect("a file has a stem").to_string_lossy();
        assert!(!VAGUE.contains(&&*stem), "{path}: the name does not describe the contents");
    }
}

/// Names after `struct`, `enum`, `trait`, `union` or an outer `type` on a line of code.
fn defined_type(line: &str) -> Option<String> {
    let is_outer = !line.starts_with(' ');
    let mut words = line.split_whitespace().skip_while(|word| word.starts_with("pub"));
    let keyword = words.next()?;
    let defines =
        ["struct", "enum", "trait", "union"].contains(&keyword) || (keyword == "type" && is_outer);
    let name: String =
        words.next()?.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    (defines && name.starts_with(char::is_uppercase)).then_some(name)
}

#[test]
fn every_type_name_is_defined_once_in_the_workspace() {
    let mut places: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    for source in sources().iter().filter(|source| !is_test(&source.path)) {
        for name in source.code.iter().filter_map(|line| defined_type(line)) {
            places.entry(name).or_default().push(source.path.clone());
        }
    }
    let repeated: Vec<_> = places.iter().filter(|(_, places)| places.len() > 1).collect();
    assert!(repeated.is_empty(), "type names defined more than once: {repeated:#?}");
    assert!(places.len() > 500, "the definitions are where this test looks for them");
}

fn is_test(path: &Path) -> bool {
    path.iter().any(|part| part == "tests" || part == "tests.rs")
}
