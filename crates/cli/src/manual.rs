//! The subcommands `dapple completions` and `dapple man`: shell completions and man pages, made from the arguments.

use crate::output::tell;
use crate::{Arguments, Failure, Outcome, Result};
use clap::{Command, CommandFactory};
use clap_complete::Shell;
use dapple_scene::image::write_file;
use std::path::{Path, PathBuf};

/// Print the completions of a shell
#[derive(clap::Args)]
#[command(after_help = "Examples:
  dapple completions bash > ~/.local/share/bash-completion/completions/dapple
  dapple completions zsh > ~/.zfunc/_dapple
  dapple completions fish > ~/.config/fish/completions/dapple.fish")]
pub(crate) struct CompletionsArgs {
    #[arg(value_name = "SHELL")]
    shell: Shell,
}

/// Print the man page of this program or of one of its commands
#[derive(clap::Args)]
#[command(after_help = "Examples:
  dapple man render | man -l -
  dapple man -o ~/.local/share/man/man1")]
pub(crate) struct ManArgs {
    /// The command, such as render
    #[arg(value_name = "COMMAND")]
    command: Option<String>,

    /// Write the pages of all commands to this folder instead
    #[arg(short, long = "output", value_name = "DIR", conflicts_with = "command")]
    output: Option<PathBuf>,
}

pub(crate) fn completions(args: &CompletionsArgs) -> Result<Outcome> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Arguments::command(), "dapple", &mut script);
    print(script)
}

pub(crate) fn man(args: &ManArgs) -> Result<Outcome> {
    let mut program = Arguments::command();
    program.build();
    if let Some(folder) = &args.output {
        write_all(&program, folder)?;
        return Ok(Outcome::Done);
    }
    let Some(name) = &args.command else { return print(page(program)?) };
    match program.get_subcommands().find(|command| command.get_name() == name && !command.is_hide_set()) {
        Some(command) => print(page(titled(command))?),
        None => {
            let known: Vec<&str> = shown(&program).map(Command::get_name).collect();
            Err(Failure::new(format!("there is no command \"{name}\"; choose among {}", known.join(", "))))
        }
    }
}

fn shown(program: &Command) -> impl Iterator<Item = &Command> {
    program.get_subcommands().filter(|command| !command.is_hide_set())
}

/// A command under the name of its page, such as `dapple-render`.
fn titled(command: &Command) -> Command {
    let name: &'static str = Box::leak(format!("dapple-{}", command.get_name()).into_boxed_str());
    command.clone().name(name)
}

fn page(command: Command) -> Result<Vec<u8>> {
    let mut roff = Vec::new();
    let cannot = |e| Failure::new(format!("cannot make the man page: {e}"));
    clap_mangen::Man::new(command).render(&mut roff).map_err(cannot)?;
    Ok(roff)
}

fn write_all(program: &Command, folder: &Path) -> Result<()> {
    let cannot = |e| Failure::new(format!("{}: cannot make the folder: {e}", folder.display()));
    std::fs::create_dir_all(folder).map_err(cannot)?;
    let pages = shown(program).map(titled).chain([program.clone()]);
    for command in pages {
        let path = folder.join(format!("{}.1", command.get_name()));
        write_file(&path, &page(command)?).map_err(Failure::new)?;
        tell(path.display().to_string())?;
    }
    Ok(())
}

/// Prints a text that ends with a line break of its own.
fn print(text: Vec<u8>) -> Result<Outcome> {
    let text = String::from_utf8(text).map_err(Failure::new)?;
    tell(text.trim_end())?;
    Ok(Outcome::Done)
}
