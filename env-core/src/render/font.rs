//! Letters of numbers and units of stress, for pictures.

/// Width and height of a letter, and distance between two letters (cells).
const CELLS: [usize; 2] = [5, 7];
const GAP: usize = 1;
const INK: [u8; 3] = [40, 40, 48];

/// Rows of a letter from the top, the leftmost cell in the highest of five bits.
fn glyph(letter: char) -> [u8; CELLS[1]] {
    match letter {
        '0' => [0x0e, 0x11, 0x13, 0x15, 0x19, 0x11, 0x0e],
        '1' => [0x04, 0x0c, 0x04, 0x04, 0x04, 0x04, 0x0e],
        '2' => [0x0e, 0x11, 0x01, 0x02, 0x04, 0x08, 0x1f],
        '3' => [0x1f, 0x02, 0x04, 0x02, 0x01, 0x11, 0x0e],
        '4' => [0x02, 0x06, 0x0a, 0x12, 0x1f, 0x02, 0x02],
        '5' => [0x1f, 0x10, 0x1e, 0x01, 0x01, 0x11, 0x0e],
        '6' => [0x06, 0x08, 0x10, 0x1e, 0x11, 0x11, 0x0e],
        '7' => [0x1f, 0x01, 0x02, 0x04, 0x08, 0x08, 0x08],
        '8' => [0x0e, 0x11, 0x11, 0x0e, 0x11, 0x11, 0x0e],
        '9' => [0x0e, 0x11, 0x11, 0x0f, 0x01, 0x02, 0x0c],
        '.' => [0x00, 0x00, 0x00, 0x00, 0x00, 0x0c, 0x0c],
        '>' => [0x08, 0x04, 0x02, 0x01, 0x02, 0x04, 0x08],
        'P' => [0x1e, 0x11, 0x11, 0x1e, 0x10, 0x10, 0x10],
        'M' => [0x11, 0x1b, 0x15, 0x15, 0x11, 0x11, 0x11],
        'a' => [0x00, 0x00, 0x0e, 0x01, 0x0f, 0x11, 0x0f],
        'k' => [0x10, 0x10, 0x12, 0x14, 0x18, 0x14, 0x12],
        _ => [0; CELLS[1]],
    }
}

/// Size of a text whose cells have `scale` pixels along each side (pixels).
pub(super) fn size(text: &str, scale: usize) -> [usize; 2] {
    [text.len() * (CELLS[0] + GAP) - GAP, CELLS[1]].map(|cells| cells * scale)
}

/// Writes `text` into a picture of `width` pixels, its upper left corner at pixel (`left`, `top`).
pub(super) fn write(
    picture: &mut [u8],
    width: usize,
    text: &str,
    scale: usize,
    [left, top]: [usize; 2],
) {
    let [across, down] = size(text, scale);
    for y in 0..down {
        for x in 0..across {
            let (place, cell) = (x / scale / (CELLS[0] + GAP), x / scale % (CELLS[0] + GAP));
            let row = glyph(text.as_bytes()[place].into())[y / scale];
            if u32::from(row) << cell & 0x10 != 0 {
                picture[3 * ((top + y) * width + left + x)..][..3].copy_from_slice(&INK);
            }
        }
    }
}

/// Stress (Pa) in three digits, with its unit.
pub(super) fn stress(pressure: f64) -> String {
    let (unit, size) = match pressure {
        p if p < 999.5 => ("Pa", 1.0),
        p if p < 999.5e3 => ("kPa", 1e3),
        _ => ("MPa", 1e6),
    };
    let number = pressure / size;
    let decimals = if number < 9.995 { 2 } else { usize::from(number < 99.95) };
    let digits = format!("{number:.decimals$}");
    let short =
        if decimals > 0 { digits.trim_end_matches('0').trim_end_matches('.') } else { &digits };
    format!("{short} {unit}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stress_has_three_digits_and_a_unit() {
        for (pressure, text) in [
            (0.3, "0.3 Pa"),
            (999.4, "999 Pa"),
            (999.6, "1 kPa"),
            (43_680.0, "43.7 kPa"),
            (120e3, "120 kPa"),
            (1.25e6, "1.25 MPa"),
        ] {
            assert_eq!(stress(pressure), text);
        }
    }

    #[test]
    fn every_letter_of_a_stress_has_a_glyph_of_its_own() {
        let letters: Vec<_> = "0123456789.>kMPa ".chars().map(glyph).collect();
        for (i, letter) in letters.iter().enumerate() {
            assert!(!letters[..i].contains(letter), "letter {i} is another");
        }
    }

    #[test]
    fn a_letter_is_written_cell_by_cell() {
        let [width, height] = size("1", 2);
        let mut picture = vec![255; 3 * width * height];
        write(&mut picture, width, "1", 2, [0, 0]);
        let dark = picture.chunks(3).filter(|pixel| **pixel == INK).count();
        assert_eq!((width, height, dark), (10, 14, 4 * 10));
    }
}
