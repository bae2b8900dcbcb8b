//! The pages for newcomers say what happens: their commands are run as they stand there, and what they show must come.
//!
//! A block marked `sh` is run by bash in an empty folder that has `deploy/` in it, with `fss` in its path; all blocks of a page
//! share the folder. A `text` block behind it shows lines that must come in this order, whatever the numbers; `...` is
//! anything. Blocks marked `console` are shown only.
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
