//! Animations as GIF (CompuServe 1990). Each frame holds the rectangle that changed, in which
//! unchanged pixels are transparent.
//!
//! Each frame has its own palette: exact for up to 256 colours, otherwise chosen by Dekker's
//! Kohonen network (Network 5, 1994).

use gif::{Encoder, EncodingError, Frame, Repeat};
use numpy::{PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::{exceptions::PyRuntimeError, prelude::*, types::PyBytes};

use crate::mechanics::arrays::{Shown, refused};

/// Speed of the choice of colours, from 1 (best colours) to 30 (fastest); 10 is the default of the
/// `gif` crate.
const SPEED: i32 = 10;

/// Encodes `frames`, arrays (H, W, 3) of one shape, as a GIF that shows each for `delay` (ms) and
/// repeats.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)] // Arguments come owned from Python.
pub(crate) fn encode_gif<'py>(
    py: Python<'py>,
    frames: Vec<PyReadonlyArray3<'py, u8>>,
    delay: usize,
) -> PyResult<Bound<'py, PyBytes>> {
    let hundredths = u16::try_from(delay / 10).ok().filter(|&d| d > 0 && delay.is_multiple_of(10));
    let hundredths = hundredths.ok_or_else(|| {
        refused("delay", format!("{delay} ms"), "10 to 655350 ms, in steps of 10")
    })?;
    let Some(shape) = frames.first().map(|frame| frame.shape().to_vec()) else {
        return Err(refused("frames", "none", "at least one"));
    };
    if let Some(other) = frames.iter().find(|frame| frame.shape() != shape) {
        let expected = format!("{} as before it", Shown(&shape));
        return Err(refused("frames", Shown(other.shape()), expected));
    }
    let side = |pixels: usize| u16::try_from(pixels).ok().filter(|&pixels| pixels > 0);
    let (Some(height), Some(width), 3) = (side(shape[0]), side(shape[1]), shape[2]) else {
        return Err(refused("frames", Shown(&shape), "array (H, W, 3), H and W from 1 to 65535"));
    };
    let pixels = |frame: &PyReadonlyArray3<u8>| -> Vec<[u8; 3]> {
        let values: Vec<u8> = frame.as_array().iter().copied().collect();
        values.as_chunks().0.to_vec()
    };
    let pictures: Vec<_> = frames.iter().map(pixels).collect();
    let encoded = py.detach(|| encode(&pictures, width, height, hundredths));
    let bytes = encoded.map_err(|error| PyRuntimeError::new_err(format!("GIF: {error}")))?;
    Ok(PyBytes::new(py, &bytes))
}

fn encode(
    pictures: &[Vec<[u8; 3]>],
    width: u16,
    height: u16,
    delay: u16,
) -> Result<Vec<u8>, EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, width, height, &[])?;
    encoder.set_repeat(Repeat::Infinite)?;
    let mut before: Option<&Vec<[u8; 3]>> = None;
    for picture in pictures {
        let mut frame = changed(before.map(Vec::as_slice), picture, usize::from(width));
        frame.delay = delay;
        encoder.write_frame(&frame)?;
        before = Some(picture);
    }
    drop(encoder);
    Ok(bytes)
}

/// Smallest rectangle of `picture` that holds all pixels that differ from `before`; its other
/// pixels are transparent.
fn changed(before: Option<&[[u8; 3]]>, picture: &[[u8; 3]], width: usize) -> Frame<'static> {
    let differs = |i: usize| before.is_none_or(|before| before[i] != picture[i]);
    let places = (0..picture.len()).filter(|&i| differs(i)).map(|i| (i % width, i / width));
    let none = (usize::MAX, 0, usize::MAX, 0);
    let (left, right, top, bottom) = places.fold(none, |(left, right, top, bottom), (x, y)| {
        (left.min(x), right.max(x), top.min(y), bottom.max(y))
    });
    // If nothing changed, a frame of one transparent pixel keeps the timing.
    let (left, top) = (left.min(right), top.min(bottom));
    let mut rgba = Vec::with_capacity(4 * (right + 1 - left) * (bottom + 1 - top));
    for y in top..=bottom {
        let first = y * width + left;
        for (i, &[r, g, b]) in (first..).zip(&picture[first..=y * width + right]) {
            rgba.extend(if differs(i) { [r, g, b, 255] } else { [0; 4] });
        }
    }
    let (wide, high) = ((right + 1 - left) as u16, (bottom + 1 - top) as u16);
    let mut frame = Frame::from_rgba_speed(wide, high, &mut rgba, SPEED);
    (frame.left, frame.top) = (left as u16, top as u16);
    frame
}
