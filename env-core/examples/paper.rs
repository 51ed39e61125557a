//! Trains one of the paper's networks, or the corrector, within a budget of processor time. Writes
//! its errors into a folder, and for one of the paper's networks also the weights.
//!
//! `paper DATA OUT RUN [TRAINING]`: RUN is JSON such as `{"paper": {"network": {"variant": "b",
//! "input": "force"}, "density": "coarse"}}` or `{"corrector": {}}`, TRAINING such as `{"seconds":
//! 1500, "seed": 1}`. Uses one thread. Runs on Linux only, as processor time is read from /proc.

mod common;

use std::{env, error::Error, fs, path::Path};

use common::{commit, processor};
use ruffini_core::surrogate::paper::PaperTrainingConfig;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = env::args().collect();
    let [_, data, out, run, rest @ ..] = args.as_slice() else {
        return Err("expected DATA OUT RUN [TRAINING]".into());
    };
    let training: PaperTrainingConfig =
        serde_json::from_str(rest.first().map_or("{}", String::as_str))?;
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global()?;
    let run = serde_json::from_str(run)?;
    let (report, weights) = training.run(&run, Path::new(data), &commit()?, &processor)?;
    fs::create_dir_all(out)?;
    let out = Path::new(out);
    fs::write(out.join("report.json"), serde_json::to_string_pretty(&report)? + "\n")?;
    if let Some(weights) = weights {
        fs::write(out.join("weights.safetensors"), weights.bytes)?;
        fs::write(out.join("card.toml"), toml::to_string_pretty(&weights.card)?)?;
    }
    Ok(())
}
