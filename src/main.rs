//! Entry point of the `palpate` command line, which [`cli`] implements.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::main()
}
