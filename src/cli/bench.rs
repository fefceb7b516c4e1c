//! `palpate bench`: the measurements of docs/performance/ on this machine.

use super::{Outcome, driver, print_json, print_notes, progress};
use clap::Args;
use palpate::bench::{
    self, Context, GOLDEN, Machine, PARTS, Part, Report, Row, Supervision, measure_all, run_part,
};
use palpate::{Error, Result};
use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Longest time of one case: the largest take minutes on a software driver.
const CASE_LIMIT: Duration = Duration::from_secs(1200);
const QUICK_CASE_LIMIT: Duration = Duration::from_secs(300);

/// Arguments of `bench`.
#[derive(Args)]
pub struct BenchArguments {
    /// Write bench.json, bench.csv, bench.md and its charts to this folder
    #[arg(long, short, default_value = "bench")]
    out: PathBuf,
    /// Measure few and small cases: two minutes on two cores
    #[arg(long)]
    quick: bool,
    /// Measure only these parts, separated by commas, after the golden comparisons: steps, grids,
    /// raycast, elements, tools, cuts, skins, scans, memory, large
    #[arg(long, value_name = "PARTS", value_delimiter = ',')]
    only: Vec<String>,
    /// Compare with the bench.json of another run
    #[arg(long, value_name = "FILE")]
    compare: Option<PathBuf>,
    /// Print the report on standard output as JSON
    #[arg(long)]
    json: bool,
    /// Compare with the golden pictures of this folder
    #[arg(long, value_name = "FOLDER", hide = true)]
    goldens: Option<PathBuf>,
    /// Measure cases of one part in this process, and print a line of JSON for each
    #[arg(long, value_name = "PART", hide = true, requires_all = ["from", "to"])]
    part: Option<String>,
    /// The first case of the part, from 0
    #[arg(long, hide = true)]
    from: Option<usize>,
    /// The end of its cases
    #[arg(long, hide = true)]
    to: Option<usize>,
}

/// Measures the parts; exit code 1 if a golden comparison does not pass. Ctrl-C ends the run early
/// and keeps the rows, a second one aborts.
pub fn run(adapter: Option<&str>, arguments: &BenchArguments) -> anyhow::Result<Outcome> {
    if let Some(name) = &arguments.part {
        return measure_here(adapter, bench::part(name)?, arguments);
    }
    let parts = selected(&arguments.only)?;
    let reference = arguments.compare.as_deref().map(Report::read).transpose()?;
    let out = &arguments.out;
    std::fs::create_dir_all(out).map_err(Error::io(out))?;
    let stop = stop_flag()?;
    let started = Instant::now();
    // The device is dropped again: the processes of the parts have their own.
    let machine = Machine::of(&driver::gpu(adapter)?);
    let mut report = Report::new(machine, arguments.quick);
    report.reference = reference.as_ref().map(|given| bench::Reference {
        file: arguments.compare.clone().unwrap_or_default(),
        machine: given.machine.clone(),
        date: given.date.clone(),
    });
    print_notes(&[format!(
        "measuring {} parts on {}",
        parts.len(),
        report.machine.adapter_line()
    )]);
    let program = std::env::current_exe().map_err(Error::io("path of this program"))?;
    let command =
        |part: &Part, cases: Range<usize>| part_command(&program, adapter, arguments, part, cases);
    let count: usize = parts.iter().map(|p| (p.cases)(arguments.quick).len()).sum();
    progress::with_bar("cases", count as u64, |bar| {
        let how = Supervision {
            command: &command,
            quick: arguments.quick,
            limit: if arguments.quick {
                QUICK_CASE_LIMIT
            } else {
                CASE_LIMIT
            },
            progress: &|part, row: &Row, case| {
                bar.set_position(case as u64);
                bar.detail(format!("{}: {}", part.name, row.label()));
            },
            stop: &stop,
        };
        measure_all(&how, &parts, &mut |rows| {
            report.add(rows, reference.as_ref());
            report.seconds = started.elapsed().as_secs_f64();
            // So that an aborted run leaves what it measured.
            report.write_json(out)
        })
    })?;
    report.ended_early = stop.load(Ordering::Relaxed);
    report.seconds = started.elapsed().as_secs_f64();
    report.write(out)?;
    print_notes(&result(&report, out));
    if arguments.json {
        print_json(&report)?;
    }
    Ok(match report.golden_failures().next() {
        Some(_) => Outcome::Negative,
        None => Outcome::Done,
    })
}

/// Returns the golden comparisons and the selected parts, in the order of the report.
fn selected(only: &[String]) -> Result<Vec<&'static Part>> {
    only.iter()
        .try_for_each(|name| bench::part(name).map(drop))?;
    let wanted = |part: &&Part| {
        only.is_empty() || part.name == GOLDEN || only.iter().any(|name| name == part.name)
    };
    Ok(PARTS.iter().filter(wanted).collect())
}

/// Returns a flag that Ctrl-C sets.
fn stop_flag() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let pressed = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if pressed.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
        print_notes(&["stopping; the measured rows are kept".to_owned()]);
    })?;
    Ok(stop)
}

/// Returns the command that measures cases of a part.
fn part_command(
    program: &Path,
    adapter: Option<&str>,
    arguments: &BenchArguments,
    part: &Part,
    cases: Range<usize>,
) -> Command {
    let mut command = Command::new(program);
    if let Some(adapter) = adapter {
        command.args(["--adapter", adapter]);
    }
    command.args(["bench", "--part", part.name]);
    command.args(["--from", &cases.start.to_string()]);
    command.args(["--to", &cases.end.to_string()]);
    if arguments.quick {
        command.arg("--quick");
    }
    if let Some(goldens) = &arguments.goldens {
        command.arg("--goldens").arg(goldens);
    }
    command
}

/// Measures cases of a part in this process; prints a line for each.
fn measure_here(
    adapter: Option<&str>,
    part: &Part,
    arguments: &BenchArguments,
) -> anyhow::Result<Outcome> {
    let gpu = driver::gpu(adapter)?;
    let context = Context {
        gpu: &gpu,
        quick: arguments.quick,
        goldens: arguments.goldens.as_deref(),
    };
    let cases = arguments.from.unwrap_or(0)..arguments.to.unwrap_or(usize::MAX);
    run_part(&context, part, cases, &mut |message| {
        let line = serde_json::to_string(message).map_err(|e| Error::Input(e.to_string()))?;
        writeln!(std::io::stdout(), "{line}").map_err(Error::io("standard output"))
    })?;
    Ok(Outcome::Done)
}

/// Returns what the user has to know at the end.
fn result(report: &Report, out: &Path) -> Vec<String> {
    let mut notes = Vec::new();
    let failures: Vec<&Row> = report.golden_failures().collect();
    for row in &failures {
        notes.push(format!(
            "golden comparison {}: {}: {} (bound {}), {}",
            row.outcome.word(),
            row.label(),
            row.median.map_or("no value".into(), |v| v.to_string()),
            row.bound.unwrap_or(f64::NAN),
            row.note
        ));
    }
    if failures.is_empty() {
        let passes = report.golden_passes();
        notes.push(format!(
            "{passes} golden comparisons are within their bounds"
        ));
    }
    if report.reference.is_some() && report.rows.iter().all(|row| row.reference.is_none()) {
        notes.push(
            "no row of the reference file measures the same: compare quick with quick runs, and \
            full with full ones"
                .into(),
        );
    }
    notes.push(format!(
        "wrote {0}/bench.md with its charts, {0}/bench.json and {0}/bench.csv",
        out.display()
    ));
    notes
}
