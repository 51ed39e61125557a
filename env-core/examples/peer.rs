//! Our half of `tests/reference/peer.py`: the pad's mesh, and the time of a frame on it.
//!
//! `peer mesh FILE.npz` writes the mesh; `peer speed` prints the least mean seconds a frame of
//! three runs as JSON, one thread, for every element without and with friction.

#[path = "../../tests/physics/bodies.rs"]
mod bodies;

use std::{env, path::Path, process::ExitCode};

use bodies::{gel_pad, press_and_shear};
use ruffini_core::{
    Error, Result,
    fem::{Element, Fem, Options},
};
use serde_json::{Map, Value, json};

/// Cells of the pad: 1,020 vertices.
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
        let [frictionless, frictional] =
            [0.0, 0.5].map(|friction| seconds(Options { element, friction, ..Options::default() }));
        times.insert(name.to_owned(), json!({ "press": frictionless?, "shear": frictional? }));
    }
    Ok(Value::Object(times))
}

/// Mean seconds a frame: pressed in only without friction, moved aside, too, with it.
fn seconds(options: Options) -> Result<f64> {
    let fem = Fem::new(gel_pad(CELLS), options)?;
    let press = press_and_shear();
    let count = if options.friction == 0.0 { 10 } else { 20 };
    let mut least = f64::INFINITY;
    for _ in 0..3 {
        let frames = fem.solve_path(&press).into_iter().take(count).collect::<Result<Vec<_>>>()?;
        let total: f64 = frames.iter().map(|frame| frame.seconds).sum();
        least = least.min(total / frames.len() as f64);
    }
    Ok(least)
}
