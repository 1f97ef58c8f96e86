//! The list of mutations: each takes one safeguard out, and names the test that must then fail.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// One entry of `tests/mutations/list.toml`.
#[derive(Clone, Debug)]
pub struct Mutation {
    pub name: String,
    /// What is taken out.
    pub safeguard: String,
    /// Ids of the cases that it serves.
    pub cases: String,
    /// What follows `cargo test`.
    pub test: String,
    pub file: String,
    pub old: String,
    pub new: String,
}

/// What became of one, as `tests/mutations/outcomes.toml` keeps it.
#[derive(Clone, Debug)]
pub struct Outcome {
    pub caught: bool,
    /// The first words of the failure, or what went wrong.
    pub said: String,
    pub commit: String,
}

pub fn mutations(root: &Path) -> Result<Vec<Mutation>, String> {
    let table = read(&root.join("tests/mutations/list.toml"))?;
    let list = table.get("mutation").and_then(toml::Value::as_array).ok_or("no [[mutation]]")?;
    let one = |row: &toml::Value| {
        let word = |key: &str| {
            let text = row.get(key).and_then(toml::Value::as_str).map(str::to_owned);
            text.ok_or_else(|| format!("a mutation lacks '{key}': {row:?}"))
        };
        Ok(Mutation {
            name: word("name")?,
            safeguard: word("safeguard")?,
            cases: word("cases")?,
            test: word("test")?,
            file: word("file")?,
            old: word("old")?,
            new: word("new")?,
        })
    };
    list.iter().map(one).collect()
}

pub fn outcome(root: &Path, name: &str) -> Option<Outcome> {
    let table = read(&root.join("tests/mutations/outcomes.toml")).ok()?;
    let row = table.get(name)?;
    let word = |key: &str| row.get(key).and_then(toml::Value::as_str).unwrap_or_default().to_owned();
    Some(Outcome { caught: row.get("caught")?.as_bool()?, said: word("said"), commit: word("commit") })
}

fn read(path: &Path) -> Result<toml::Table, String> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    toml::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))
}

impl Mutation {
    /// The file without the safeguard.
    ///
    /// # Errors
    ///
    /// Where the text to replace is not there exactly once: then the entry is out of date.
    pub fn applied(&self, root: &Path) -> Result<String, String> {
        let path = root.join(&self.file);
        let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        match text.matches(&self.old).count() {
            1 => Ok(text.replacen(&self.old, &self.new, 1)),
            n => Err(format!(
                "mutation {}: its text is {n} times in {}, not once: mend tests/mutations/list.toml",
                self.name, self.file
            )),
        }
    }

    /// Runs the test in `tree`, a copy of the repository, without the safeguard, and puts the file back.
    ///
    /// # Errors
    ///
    /// Where it cannot be applied, or does not compile.
    pub fn run(&self, tree: &Path, commit: &str) -> Result<(Outcome, f64), String> {
        let path = tree.join(&self.file);
        let sound = std::fs::read_to_string(&path).map_err(|e| e.to_string())?;
        std::fs::write(&path, self.applied(tree)?).map_err(|e| e.to_string())?;
        let start = Instant::now();
        // Some loop for ever without their safeguard; `timeout` ends cargo and what it has started.
        let result = Command::new("timeout")
            .args(["1200", env!("CARGO"), "test"])
            .args(self.test.split_whitespace())
            .env("CARGO_TARGET_DIR", tree.join("target"))
            .env("RUST_BACKTRACE", "0")
            .current_dir(tree)
            .output();
        std::fs::write(&path, sound).map_err(|e| e.to_string())?;
        let output = result.map_err(|e| e.to_string())?;
        let text = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        if !text.contains("running ") {
            return Err(format!("{}: nothing was run:\n{text}", self.name));
        }
        let caught = !output.status.success() && text.contains("FAILED");
        Ok((Outcome { caught, said: failure(&text), commit: commit.to_owned() }, start.elapsed().as_secs_f64()))
    }
}

/// The line after `panicked at`, cut to what a table bears.
fn failure(text: &str) -> String {
    let mut lines = text.lines().skip_while(|l| !l.contains("panicked at"));
    lines.next();
    let line: String = lines.next().unwrap_or("").chars().filter(|c| !"|`\"\\".contains(*c)).take(120).collect();
    line.trim().to_owned()
}

/// The section of the page.
pub fn section(root: &Path) -> Result<String, String> {
    let mut text = String::from(
        "\n## Without its safeguard each fails\n\nEvery safeguard was taken out once, by a small change of the text \
         ([tests/mutations/list.toml](../../tests/mutations/list.toml)), and the test named was run: `cargo run --release \
         --example hard_cases -- --mutations [NAME]...`, by hand. That every entry still applies is tested.\n\n\
         | safeguard | cases | test | without it | at |\n|---|---|---|---|---|\n",
    );
    for m in mutations(root)? {
        let (said, commit) = match outcome(root, &m.name) {
            None => ("not run yet".to_owned(), String::new()),
            Some(o) if o.caught => (format!("fails: {}", o.said), o.commit),
            Some(o) => ("**passes: the test does not hold it**".to_owned(), o.commit),
        };
        text += &format!("| {} | {} | `{}` | {said} | {commit} |\n", m.safeguard, m.cases, m.test);
    }
    Ok(text)
}
