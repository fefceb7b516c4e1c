//! `palpate adapters`: lists the graphics adapters.

use super::{Outcome, driver, print_json};
use clap::Args;
use palpate::gpu::Gpu;
use serde_json::{Value, json};
use std::io::Write;

/// Arguments of `adapters`.
#[derive(Args)]
pub struct AdaptersArguments {
    /// Print the list on standard output as JSON
    #[arg(long)]
    json: bool,
}

/// Lists the adapters, and marks the one selected by `wanted`.
pub fn run(wanted: Option<&str>, arguments: &AdaptersArguments) -> anyhow::Result<Outcome> {
    let (chosen, all) = driver::with_driver_output_held(wanted, || {
        Ok((Gpu::with_adapter(wanted)?.adapter_name(), Gpu::adapters()))
    })?;
    let numbered = all.iter().enumerate();
    if arguments.json {
        let one = |(index, name): (usize, &String)| json!({ "index": index, "adapter": name, "chosen": *name == chosen });
        let list: Vec<Value> = numbered.map(one).collect();
        print_json(&json!({ "adapters": list }))?;
        return Ok(Outcome::Done);
    }
    let mut out = std::io::stdout().lock();
    for (i, name) in numbered {
        let mark = if *name == chosen { "*" } else { " " };
        writeln!(out, "{mark} {i}: {name}")?;
    }
    Ok(Outcome::Done)
}
