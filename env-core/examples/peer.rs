//! Counterpart of `tests/reference/peer.py` in this library: the pad's mesh, and the time of a
//! frame on it.
//!
//! `peer mesh FILE.npz` writes the mesh. `peer speed` prints as JSON, for every element without and
//! with friction, the mean time of a frame (s), the smaller of two runs on one thread, and the
//! force at the end (N).

#[path = "../../tests/physics/bodies.rs"]
mod bodies;

use std::{env, path::Path, process::ExitCode};

use bodies::{gel_pad, press_and_shear};
use ruffini_core::{
    Error, Result,
    fem::{Element, Fem, FemOptions},
};
use serde_json::{Map, Value, json};

/// Numbers of cells of the pad, which give 1,020 vertices.
const CELLS: [usize; 3] = [14, 16, 3];

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let done = match &arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["mesh", file] => gel_pad(CELLS).mesh().write(Path::new(file), &[]),
        ["speed"] => speed().map(|times| println!("{times}")),
        _ => Err(Error::invalid("arguments", arguments.join(" "), "mesh FILE.npz, or speed")),
    };
    done.map_or_else(
        |error| {
            eprintln!("{error}");
            ExitCode::FAILURE
        },
        |()| ExitCode::SUCCESS,
    )
}

fn speed() -> Result<Value> {
    let mut times = Map::new();
    for (name, element) in Element::NAMES {
        let time = |friction| timed(FemOptions { element, friction, ..FemOptions::default() });
        times.insert(name.to_owned(), json!({ "press": time(0.0)?, "shear": time(0.5)? }));
    }
    Ok(Value::Object(times))
}

/// Time and final force of one configuration. Without friction the ball is only pressed in; with
/// friction it is also moved sideways.
fn timed(options: FemOptions) -> Result<Value> {
    let fem = Fem::new(gel_pad(CELLS), options)?;
    let count = if options.friction == 0.0 { 10 } else { 20 };
    let (mut seconds, mut force) = (f64::INFINITY, 0.0);
    for _ in 0..2 {
        let frames = fem.solve_path(&press_and_shear());
        let frames = frames.into_iter().take(count).collect::<Result<Vec<_>>>()?;
        let total: f64 = frames.iter().map(|frame| frame.seconds).sum();
        seconds = f64::min(seconds, total / count as f64);
        force = frames.last().map_or(0.0, |frame| frame.wrench.force.norm());
    }
    Ok(json!({ "seconds": seconds, "force": force }))
}
