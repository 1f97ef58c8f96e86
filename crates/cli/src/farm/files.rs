//! The folder of a job: files that are written under temporary names, then renamed.

use crate::{Failure, Result};
use dapple_scene::image::write_file;
use std::path::{Path, PathBuf};

/// The files of a job, to be written together once all are made.
pub(super) struct Files {
    folder: PathBuf,
    all: Vec<(PathBuf, String, bool)>,
}

impl Files {
    /// Files for this folder, which is created.
    pub(super) fn new(folder: &Path) -> Result<Self> {
        let make = |folder: &Path| {
            std::fs::create_dir_all(folder)
                .map_err(|e| Failure::new(format!("{}: cannot make the folder: {e}", folder.display())))
        };
        make(folder)?;
        make(&folder.join("log"))?;
        Ok(Self { folder: folder.to_owned(), all: Vec::new() })
    }

    /// Adds a file. The description of the render must be that of the job that is there already.
    pub(super) fn add(&mut self, name: &str, text: &str) -> Result<()> {
        let path = self.folder.join(name);
        if name == DESCRIPTION
            && let Ok(there) = std::fs::read_to_string(&path)
            && there.trim() != text.trim()
        {
            let folder = self.folder.display();
            return Err(Failure::new(format!(
                "{folder} holds a job of another render, whose finished parts would be taken; choose another --output"
            )));
        }
        self.all.push((path, text.trim_end().to_owned() + "\n", false));
        Ok(())
    }

    /// Adds a shell script.
    pub(super) fn add_script(&mut self, name: &str, text: &str) -> Result<()> {
        self.add(name, text)?;
        if let Some((_, _, script)) = self.all.last_mut() {
            *script = true;
        }
        Ok(())
    }

    /// Writes all files.
    pub(super) fn finish(self) -> Result<()> {
        for (path, text, script) in self.all {
            write_file(&path, text.as_bytes()).map_err(Failure::new)?;
            if script {
                make_executable(&path).map_err(|e| Failure::new(format!("{}: {e}", path.display())))?;
            }
        }
        Ok(())
    }
}

/// The file with the description of the render.
pub(super) const DESCRIPTION: &str = "render.json";

#[cfg(unix)]
fn make_executable(path: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt as _;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755))
}

#[cfg(not(unix))]
fn make_executable(_: &Path) -> std::io::Result<()> {
    Ok(())
}

/// Text as one argument of a shell.
pub(super) fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}
