//! Trains one of the paper's networks, or the corrector, within a budget of processor time and writes
//! its errors as JSON.
//!
//! `paper DATA OUT.json RUN.json SECONDS SEED [BATCH RATE EVERY]`, where RUN.json is such as
//! `{"paper": {"network": {"variant": "b", "input": "force", "width": 32, "rounds": 4},
//! "density": "coarse"}}` or `{"corrector": {}}`. One thread. Linux, whose /proc tells the time.

use std::{fs, path::Path};

use ruffini_core::surrogate::paper::Study;

/// Processor time of this process (s).
fn processor() -> f64 {
    let text = fs::read_to_string("/proc/self/stat").expect("a Linux with /proc");
    let fields: Vec<&str> =
        text.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    let ticks = |i: usize| -> f64 { fields[i].parse().expect("a number of ticks") };
    (ticks(11) + ticks(12)) / 100.0
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().collect();
    let [_, data, out, run, seconds, seed, rest @ ..] = args.as_slice() else {
        return Err("expected DATA OUT.json RUN.json SECONDS SEED [BATCH RATE EVERY]".into());
    };
    let number = |i: usize, usual: f64| rest.get(i).map_or(Ok(usual), |text| text.parse());
    let study = Study {
        split: "novel-14".to_owned(),
        seed: seed.parse()?,
        seconds: seconds.parse()?,
        batch: number(0, 4.0)? as usize,
        rate: number(1, 2e-3)?,
        every: number(2, 1.0)? as usize,
    };
    let run = serde_json::from_str(&fs::read_to_string(run)?)?;
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global()?;
    let report = study.run(&run, Path::new(data), &processor)?;
    fs::write(out, serde_json::to_string_pretty(&report)? + "\n")?;
    Ok(())
}
