//! Functions shared by the training programs. Runs on Linux only, as processor time is read from
//! /proc.

use std::{error::Error, fs, process::Command};

/// Processor time of this process (s).
pub(crate) fn processor() -> f64 {
    let text = fs::read_to_string("/proc/self/stat").expect("a Linux with /proc");
    let fields: Vec<&str> =
        text.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    let ticks = |i: usize| -> f64 { fields[i].parse().expect("a number of ticks") };
    (ticks(11) + ticks(12)) / 100.0
}

/// The commit that is checked out.
pub(crate) fn commit() -> Result<String, Box<dyn Error>> {
    let output = Command::new("git").args(["rev-parse", "--short", "HEAD"]).output()?;
    Ok(String::from_utf8(output.stdout)?.trim().to_owned())
}
