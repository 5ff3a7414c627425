//! The programs of a mission as child processes: named, their output kept and shown, stopped the way an operator would.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read, Write as _};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::{Context as _, bail};
use rustix::process::{Pid, Signal, kill_process};

/// A running program. Dropping it kills it, so that a failed mission leaves nothing behind.
pub struct Program {
    name: &'static str,
    pid: Pid,
    exit: Receiver<std::io::Result<ExitStatus>>,
    exited: bool,
    pumps: Vec<JoinHandle<()>>,
}

impl Program {
    /// Starts `command`. Its output goes to `log`, and to this program's standard error if `show` says so.
    pub fn start(
        name: &'static str,
        mut command: Command,
        log: &Path,
        show: Show,
    ) -> anyhow::Result<Self> {
        let program = command.get_program().to_owned();
        let mut child = command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .with_context(|| format!("cannot start {name} as {}", program.display()))?;
        let pid = Pid::from_child(&child);
        let log = File::create(log).with_context(|| format!("cannot write {}", log.display()))?;
        let mut pumps = Vec::new();
        if let Some(stdout) = child.stdout.take() {
            pumps.push(pump(
                name,
                stdout,
                log.try_clone().context("cannot share a log file")?,
                show,
            )?);
        }
        if let Some(stderr) = child.stderr.take() {
            pumps.push(pump(name, stderr, log, show)?);
        }
        Ok(Self {
            name,
            pid,
            exit: wait_in_background(name, child)?,
            exited: false,
            pumps,
        })
    }

    /// Waits until the program has ended by itself.
    pub fn wait(&mut self, patience: Duration) -> anyhow::Result<()> {
        let status = match self.exit.recv_timeout(patience) {
            Ok(status) => status.with_context(|| format!("cannot wait for {}", self.name))?,
            Err(RecvTimeoutError::Timeout) => {
                bail!(
                    "{} has not finished after {} s",
                    self.name,
                    patience.as_secs()
                )
            }
            Err(RecvTimeoutError::Disconnected) => bail!("{} has already ended", self.name),
        };
        self.exited = true;
        self.pumps.drain(..).for_each(|pump| drop(pump.join()));
        if !status.success() {
            bail!("{} ended with {status}", self.name);
        }
        Ok(())
    }

    /// Asks the program to end, as a service manager does, and waits until it has.
    pub fn stop(&mut self, patience: Duration) -> anyhow::Result<()> {
        if let Ok(status) = self.exit.try_recv() {
            self.exited = true;
            bail!(
                "{} ended too early: {}",
                self.name,
                status.context("and its state is unknown")?
            );
        }
        kill_process(self.pid, Signal::TERM)
            .with_context(|| format!("cannot stop {}", self.name))?;
        self.wait(patience)
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        if !self.exited && self.exit.try_recv().is_err() {
            // Failing means that it has just ended, which is what is wanted.
            let _already_ended = kill_process(self.pid, Signal::KILL);
        }
    }
}

/// Whether people see a program's output while it runs.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Show {
    /// Each line, behind the program's name.
    Lines,
    /// Only in the log file.
    Nothing,
}

fn wait_in_background(
    name: &'static str,
    mut child: Child,
) -> anyhow::Result<Receiver<std::io::Result<ExitStatus>>> {
    let (sender, receiver) = sync_channel(1);
    thread::Builder::new()
        .name(format!("wait {name}"))
        .spawn(move || drop(sender.send(child.wait())))
        .with_context(|| format!("cannot start a thread for {name}"))?;
    Ok(receiver)
}

fn pump(
    name: &'static str,
    output: impl Read + Send + 'static,
    mut log: File,
    show: Show,
) -> anyhow::Result<JoinHandle<()>> {
    let copy = move || {
        for line in BufReader::new(output).lines().map_while(Result::ok) {
            // A full disk must not stop the mission: the line is still shown.
            drop(writeln!(log, "{line}"));
            if show == Show::Lines {
                drop(writeln!(std::io::stderr(), "{name:>13} | {line}"));
            }
        }
    };
    thread::Builder::new()
        .name(format!("log {name}"))
        .spawn(copy)
        .with_context(|| format!("cannot start a thread for {name}"))
}
