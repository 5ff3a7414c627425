//! `evaluate SUITE --out DIR`: reproduces a table of figures, prints it and writes it to `DIR/SUITE.json`.

use std::env;
use std::io::{self, Write as _};
use std::path::PathBuf;

use clap::Parser;
use tests::evaluate::{self, Request, SlamOptions, Suite};

/// Measures one part of Tandem against its rivals: prints a table and writes the figures to DIR/SUITE.json.
#[derive(Parser)]
#[command(name = "evaluate", version)]
struct Arguments {
    /// What to measure
    suite: Suite,
    /// Folder for SUITE.json, made if missing
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// First of the random seeds [default: the suite's own, of those that nothing is tuned on]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Folder with recordings, for suites that measure on them
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    #[command(flatten)]
    slam: SlamOptions,
    /// One run of the SLAM's suite, in this process
    #[arg(long, value_name = "FILE", hide = true)]
    slam_job: Option<PathBuf>,
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    if let Some(job) = &arguments.slam_job {
        return evaluate::run_slam_job(job);
    }
    let command = evaluate::command_line(env::args_os());
    let mut say = |text: &str| drop(writeln!(io::stderr(), "{text}"));
    // Before minutes of measuring, not after.
    evaluate::make_folder(&arguments.out)?;
    let outcome = arguments.suite.run(&mut Request {
        seed: arguments.seed,
        data: arguments.data.as_deref(),
        out: &arguments.out,
        slam: &arguments.slam,
        say: &mut say,
    })?;
    writeln!(io::stdout(), "{}", outcome.text)?;
    let file = evaluate::write(&arguments.out, arguments.suite, &command, &outcome.figures)?;
    writeln!(io::stdout(), "in {}", file.display())?;
    Ok(())
}
