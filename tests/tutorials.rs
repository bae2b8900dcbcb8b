//! The pages for newcomers say what happens: their commands are run as they stand there, and what they show must come.
//!
//! A block marked `sh` is run by bash in an empty folder that has `deploy/` in it, with `fss` in its path; all blocks of a page
//! share the folder. A `text` block behind it shows lines that must come in this order, whatever the numbers; `...` is
//! anything. Blocks marked `console` are shown only. The developer page's `rust` block is compiled where the page puts it.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::{Path, PathBuf};
use std::process::Command;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// A fenced block of a page.
struct Block {
    language: String,
    text: String,
    line: usize,
}

fn page(name: &str) -> String {
    std::fs::read_to_string(Path::new(ROOT).join("docs").join(name)).unwrap()
}

fn blocks(page: &str) -> Vec<Block> {
    let mut found: Vec<Block> = Vec::new();
    let mut is_inside = false;
    for (text, line) in page.lines().zip(1..) {
        match text.strip_prefix("```") {
            Some(language) if !is_inside => {
                found.push(Block { language: language.to_owned(), text: String::new(), line });
                is_inside = true;
            }
            Some(_) => is_inside = false,
            None if is_inside => {
                let block = found.last_mut().unwrap();
                block.text.push_str(text);
                block.text.push('\n');
            }
            None => {}
        }
    }
    found
}

/// A line without what may differ: numbers are `#`, and any white space is one space.
fn shape(line: &str) -> String {
    let mut shape = String::new();
    let mut in_number = false;
    for c in line.split_whitespace().collect::<Vec<_>>().join(" ").chars() {
        let is_number = c.is_ascii_digit() || (in_number && c == '.');
        if is_number && !in_number {
            // A sign belongs to the number.
            if shape.ends_with('-') {
                shape.pop();
            }
            shape.push('#');
        }
        if !is_number {
            shape.push(c);
        }
        in_number = is_number;
    }
    shape
}

/// The commands of a page, run; what is shown must come.
fn follow(name: &str) {
    let folder = tempfile::tempdir().unwrap();
    std::os::unix::fs::symlink(Path::new(ROOT).join("deploy"), folder.path().join("deploy")).unwrap();
    let program = PathBuf::from(env!("CARGO_BIN_EXE_fss"));
    let path = format!("{}:{}", program.parent().unwrap().display(), std::env::var("PATH").unwrap());
    let blocks = blocks(&page(name));
    assert!(blocks.iter().any(|block| block.language == "sh"), "{name} has no commands");
    let mut said = String::new();
    for block in blocks {
        let place = format!("docs/{name}:{}", block.line);
        match block.language.as_str() {
            "sh" => {
                let output = Command::new("bash")
                    .args(["-euo", "pipefail", "-c", &block.text])
                    .current_dir(folder.path())
                    .env("PATH", &path)
                    .output()
                    .unwrap();
                said = String::from_utf8_lossy(&output.stdout).into_owned();
                let complaint = String::from_utf8_lossy(&output.stderr);
                assert!(output.status.success(), "{place} fails:\n{said}\n{complaint}");
            }
            "text" => {
                let mut came = said.lines();
                for line in block.text.lines().filter(|line| *line != "...") {
                    let wanted = shape(line);
                    assert!(came.any(|line| shape(line).starts_with(&wanted)), "{place}: '{line}' is not in\n{said}");
                }
            }
            _ => {}
        }
    }
}

#[test]
fn the_first_hour_goes_as_its_page_says() {
    follow("first-hour.md");
}

#[test]
fn an_operator_day_goes_as_its_page_says() {
    follow("operator.md");
}

#[test]
fn every_path_that_the_pages_name_exists() {
    for name in ["first-hour.md", "operator.md", "developer.md"] {
        let text = page(name);
        let named = text.split('`').skip(1).step_by(2).filter(|word| {
            let is_path = word.contains('/') && !word.contains(|c: char| c.is_whitespace() || "$<*{".contains(c));
            is_path && !word.starts_with("out/") && !word.ends_with("base_cubic_drag.rs")
        });
        let linked = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
        let linked = linked.filter(|link| !link.starts_with("http")).map(|link| format!("docs/{link}"));
        let mut count = 0;
        for path in named.map(str::to_owned).chain(linked) {
            assert!(Path::new(ROOT).join(&path).exists(), "docs/{name} names {path}, which is not there");
            count += 1;
        }
        assert!(count > 0, "docs/{name} names nothing");
    }
}

/// The words of a page between back quotes.
fn code_words(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

fn copy(from: &Path, to: &Path) {
    if from.is_file() {
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::copy(from, to).unwrap();
        return;
    }
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        copy(&entry.path(), &to.join(entry.file_name()));
    }
}

/// The workspace's manifest for a folder that has only `libs/plant` of its own; unoptimised, as that compiles fastest.
fn manifest_of_plant_alone() -> String {
    let mut manifest: toml::Table = std::fs::read_to_string(format!("{ROOT}/Cargo.toml")).unwrap().parse().unwrap();
    manifest.remove("profile");
    let workspace = manifest["workspace"].as_table_mut().unwrap();
    workspace.remove("default-members");
    workspace.insert("members".to_owned(), vec!["libs/plant"].into());
    for (_, dependency) in workspace["dependencies"].as_table_mut().unwrap() {
        if let Some(path) = dependency.get_mut("path") {
            *path = format!("{ROOT}/{}", path.as_str().unwrap()).into();
        }
    }
    toml::to_string(&manifest).unwrap()
}

/// Adds an effect as the page says: the file of its `rust` block, and its two lines.
fn add_the_effect(page: &str, folder: &Path) {
    let name = "libs/plant/src/effects/base_cubic_drag.rs";
    assert!(code_words(page).any(|word| word == name), "the page says where its effect goes: {name}");
    let block = blocks(page).into_iter().find(|block| block.language == "rust").unwrap();
    std::fs::write(folder.join(name), block.text).unwrap();
    let word = |begin: &str| code_words(page).find(|word| word.starts_with(begin)).unwrap();
    let (module, entry) = (word("mod base_cubic_drag"), word("&base_cubic_drag::"));
    let catalogue = folder.join("libs/plant/src/effects/mod.rs");
    let (first, list) = ("mod base_angular_drag;", "CATALOGUE: &[&dyn EffectKind] = &[");
    let text = std::fs::read_to_string(&catalogue).unwrap();
    let text = text.replacen(first, &format!("{first}\n{module}"), 1);
    std::fs::write(&catalogue, text.replacen(list, &format!("{list}\n{entry},"), 1)).unwrap();
}

#[test]
fn the_effect_of_the_developer_page_compiles_and_acts_where_the_page_puts_it() {
    // The folder stays, so that foreign crates are compiled once; what the page is about is taken anew.
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("developer-page");
    let _there_may_be_none = std::fs::remove_dir_all(folder.join("libs"));
    let tests = ["libs/plant/tests/common", "libs/plant/tests/plant_file.rs"];
    let taken = ["Cargo.lock", "deploy/etc/plants", "docs/effects.md", "libs/plant/Cargo.toml", "libs/plant/src"];
    for path in taken.iter().chain(&tests) {
        copy(&Path::new(ROOT).join(path), &folder.join(path));
    }
    std::fs::write(folder.join("Cargo.toml"), manifest_of_plant_alone()).unwrap();
    std::fs::write(folder.join("libs/plant/tests/base_cubic_drag.rs"), include_str!("data/base_cubic_drag.rs"))
        .unwrap();
    add_the_effect(&page("developer.md"), &folder);
    let output = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
        .args(["test", "--offline", "--quiet", "-p", "fss-plant", "--test", "base_cubic_drag", "--test", "plant_file"])
        .arg("--target-dir")
        .arg(folder.join("target"))
        // What has the word in its name: all of the new tests, and of the old ones that which writes the catalogue's page.
        .args(["--", "page"])
        .current_dir(&folder)
        .env("FSS_BLESS", "1")
        .env("CARGO_PROFILE_DEV_DEBUG", "false")
        .output()
        .unwrap();
    let said = [output.stdout, output.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat();
    assert!(output.status.success(), "what docs/developer.md says of an effect fails:\n{said}");
    let listed = std::fs::read_to_string(folder.join("docs/effects.md")).unwrap();
    assert!(listed.contains("| `base_cubic_drag` |"), "the catalogue's page lists it:\n{listed}");
}

/// Whether a file, or one in a folder, has this word.
fn has_word(path: &Path, word: &str) -> bool {
    if path.is_file() {
        return std::fs::read_to_string(path).is_ok_and(|text| text.contains(word));
    }
    std::fs::read_dir(path).unwrap().any(|entry| has_word(&entry.unwrap().path(), word))
}

#[test]
fn every_name_on_the_developer_page_is_in_a_file_that_its_section_names() {
    let text = page("developer.md");
    let mut count = 0;
    for section in text.split("\n## ").skip(1) {
        // Without the example: its names are the compiler's business.
        let section = section.split("```").step_by(2).collect::<Vec<_>>().concat();
        let exists = |word: &&str| Path::new(ROOT).join(word).exists();
        let paths: Vec<&str> = code_words(&section).filter(exists).collect();
        // Nor are commands names.
        let is_name = |word: &&str| !exists(word) && !word.contains("base_cubic_drag") && !word.starts_with("fss ");
        for name in code_words(&section).filter(is_name) {
            let found = paths.iter().any(|path| has_word(&Path::new(ROOT).join(path), name));
            assert!(found, "docs/developer.md speaks of `{name}`, which is in none of {paths:?}");
            count += 1;
        }
    }
    assert!(count > 0, "the page names nothing");
}
