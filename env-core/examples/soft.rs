//! Trains the soft objects' network within a budget of processor time and writes its weights and card.
//!
//! `soft DATA OUT [STUDY]`: STUDY is JSON such as `{"seconds": 1200, "seed": 1}`. Two threads. Linux,
//! whose /proc tells the time.

mod common;

use std::{env, error::Error, fs, path::Path};

use common::{commit, processor};
use ruffini_core::surrogate::soft::SoftStudy;

/// Threads.
const THREADS: usize = 2;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = env::args().collect();
    let [_, data, out, rest @ ..] = args.as_slice() else {
        return Err("expected DATA OUT [STUDY]".into());
    };
    let study: SoftStudy = serde_json::from_str(rest.first().map_or("{}", String::as_str))?;
    rayon::ThreadPoolBuilder::new().num_threads(THREADS).build_global()?;
    let (card, bytes) = study.run(Path::new(data), &commit()?, &processor, &|steps, done, now| {
        let (net, linear) = (&now.network, &now.linear);
        println!(
            "{:3.0} % {steps:6} steps: u {:.4} for {:.4}, stress {:.4} for {:.4}, force {:.4} for {:.4}",
            100.0 * done,
            net.displacement.median,
            linear.displacement.median,
            net.stress.median,
            linear.stress.median,
            net.force.map_or(f64::NAN, |f| f.median),
            linear.force.map_or(f64::NAN, |f| f.median),
        );
    })?;
    fs::create_dir_all(out)?;
    let out = Path::new(out);
    fs::write(out.join("soft.safetensors"), bytes)?;
    fs::write(out.join("soft.toml"), toml::to_string_pretty(&card)?)?;
    Ok(())
}
