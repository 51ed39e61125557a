//! Undeformed shape of a gel pad: a rectangular block with a crowned face and a rim.

use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::TetMesh;
use crate::{Error, Result};

/// The undeformed shape of a gel pad: a rectangular block with a crowned face.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PadOutline {
    /// Extent along y (m).
    pub length: f64,
    /// Extent along x (m).
    pub width: f64,
    /// Height of the apex above the base (m).
    pub thickness: f64,
    /// Radius of the face along y (m), infinite if straight.
    pub radius_along: f64,
    /// Radius of the face along x (m), infinite if straight.
    pub radius_across: f64,
    /// Width of the rim along which the face rolls off towards the sides (m), 0 if sharp.
    pub rim_width: f64,
    /// Radius of that roll-off (m): the width for a fillet that meets the sides smoothly, more for
    /// one that meets them at an angle.
    pub rim_radius: f64,
}

/// Least height of the corners, relative to the thickness.
const LOWEST: f64 = 0.05;

impl PadOutline {
    /// A block with a flat face and sharp edges.
    pub fn flat(length: f64, width: f64, thickness: f64) -> Self {
        let (radius_along, radius_across) = (f64::INFINITY, f64::INFINITY);
        let (rim_width, rim_radius) = (0.0, 0.0);
        Self { length, width, thickness, radius_along, radius_across, rim_width, rim_radius }
    }

    /// Returns this outline if its values are in range and its corners are higher than 5 % of its
    /// thickness.
    pub fn validated(self) -> Result<Self> {
        let extents =
            [("length", self.length), ("width", self.width), ("thickness", self.thickness)];
        for (name, value) in extents {
            if !(value > 1e-4 && value < 1.0) {
                return Err(Error::invalid(name, format!("{value} m"), "1e-4 to 1 m"));
            }
        }
        let radii = [
            ("radius_along", self.radius_along, 0.5 * self.length),
            ("radius_across", self.radius_across, 0.5 * self.width),
        ];
        for (name, radius, half) in radii {
            if radius.is_nan() || radius < half {
                let expected = format!("half of the extent ({half} m) or more");
                return Err(Error::invalid(name, format!("{radius} m"), expected));
            }
        }
        let most = (0.5 * self.length.min(self.width)).min(self.rim_radius);
        if !(self.rim_width >= 0.0 && self.rim_width <= most) {
            let expected = format!("0 to its radius and half of the shorter side ({most} m)");
            return Err(Error::invalid("rim_width", format!("{} m", self.rim_width), expected));
        }
        self.check_corners()?;
        Ok(self)
    }

    /// Returns an error unless the corners are higher than [`LOWEST`] of the thickness. It names
    /// the rim if the corners would be high enough without one, otherwise the thickness.
    fn check_corners(&self) -> Result<()> {
        let crowns = [
            sagitta(0.5 * self.width, self.radius_across),
            sagitta(0.5 * self.length, self.radius_along),
        ];
        let (crown, rim) = (crowns[0] + crowns[1], sagitta(self.rim_width, self.rim_radius));
        let most = (1.0 - LOWEST) * self.thickness;
        if crown + rim < most {
            return Ok(());
        }
        let thicker = (1e6 * (crown + rim) / (1.0 - LOWEST)).ceil() / 1e6;
        let falls = format!(
            "from its middle to its corners the face falls by {:.6} m by radius_across, {:.6} m by \
             radius_along and {rim:.6} m by the rim",
            crowns[0], crowns[1]
        );
        if crown >= most {
            let expected = format!("more than {thicker} m: {falls}");
            return Err(Error::invalid("thickness", format!("{} m", self.thickness), expected));
        }
        let deepest = most - crown;
        let narrower = (deepest * (2.0 * self.rim_radius - deepest)).sqrt();
        let narrower = (1e6 * narrower).floor() / 1e6;
        let expected =
            format!("less than {narrower} m, or a thickness of more than {thicker} m: {falls}");
        Err(Error::invalid("rim_width", format!("{} m", self.rim_width), expected))
    }

    /// Height of the face at (x, y) (m): 0 at the apex, negative elsewhere.
    pub fn height(&self, x: f64, y: f64) -> f64 {
        let beyond = |p: f64, extent: f64| (p.abs() - (0.5 * extent - self.rim_width)).max(0.0);
        // Round the corners the rim keeps its width and ends at one height.
        let over = beyond(x, self.width).hypot(beyond(y, self.length)).min(self.rim_width);
        let crown = sagitta(x, self.radius_across) + sagitta(y, self.radius_along);
        -crown - sagitta(over, self.rim_radius)
    }

    /// Triangles of a mesh's boundary that lie in the face, outward; none if it is no mesh of this
    /// pad.
    pub fn face_of(&self, mesh: &TetMesh) -> Vec<[u32; 3]> {
        /// Distance from the face of vertices in it, relative to the thickness.
        const ROUNDING: f64 = 1e-9;
        let is_near = |a: f64, b: f64| (a - b).abs() <= ROUNDING * self.thickness;
        let extent = |axis: usize, sign: f64| {
            let along = mesh.vertices.iter().map(|p| sign * p[axis]);
            along.fold(f64::NEG_INFINITY, f64::max)
        };
        let sides = [0.5 * self.width, 0.5 * self.length, self.thickness];
        let is_as_large = sides.iter().enumerate().all(|(axis, &side)| {
            is_near(extent(axis, -1.0), side) && (axis == 2 || is_near(extent(axis, 1.0), side))
        });
        if !is_as_large {
            return Vec::new();
        }
        let is_in_face = |p: &Point3<f64>| is_near(p.z, self.height(p.x, p.y));
        let in_face: Vec<_> = mesh.vertices.iter().map(is_in_face).collect();
        let boundary = mesh.boundary().into_iter();
        boundary.filter(|corners| corners.iter().all(|&i| in_face[i as usize])).collect()
    }

    /// Returns whether a point is in the pad.
    pub fn contains(&self, point: &Point3<f64>) -> bool {
        let [x, y, z] = point.coords.into();
        let over = x.abs() <= 0.5 * self.width && y.abs() <= 0.5 * self.length;
        over && z >= -self.thickness && z <= self.height(x, y)
    }

    /// Rotation by the shortest way from the z axis to the outward normal of the face at (x, y).
    pub fn tilt(&self, x: f64, y: f64) -> Matrix3<f64> {
        let beyond = |p: f64, extent: f64| {
            let beyond = (p.abs() - (0.5 * extent - self.rim_width)).max(0.0);
            beyond.copysign(p)
        };
        let [over_x, over_y] = [beyond(x, self.width), beyond(y, self.length)];
        let over = over_x.hypot(over_y);
        let on_rim = over > 0.0 && over <= self.rim_width;
        let by_rim = if on_rim { steepness(over, self.rim_radius) / over } else { 0.0 };
        let rise = [
            steepness(x, self.radius_across) + by_rim * over_x,
            steepness(y, self.radius_along) + by_rim * over_y,
        ];
        let [nx, ny, nz] = Vector3::new(rise[0], rise[1], 1.0).normalize().into();
        let [xx, xy, yy] = [nx * nx, nx * ny, ny * ny].map(|product| product / (1.0 + nz));
        Matrix3::new(1.0 - xx, -xy, nx, -xy, 1.0 - yy, ny, -nx, -ny, nz)
    }
}

/// Drop of a circle of `radius` at `p` from its top: r − √(r² − p²) without cancellation.
fn sagitta(p: f64, radius: f64) -> f64 {
    if p == 0.0 || radius.is_infinite() {
        return 0.0;
    }
    p * p / (radius + (radius * radius - p * p).max(0.0).sqrt())
}

/// Derivative of [`sagitta`] by `p`.
fn steepness(p: f64, radius: f64) -> f64 {
    if p == 0.0 || radius.is_infinite() {
        return 0.0;
    }
    // The end of a quarter of a circle is upright.
    p / (radius * radius - p * p).max(1e-6 * radius * radius).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::examples::mini;

    #[test]
    fn a_pad_contains_what_is_under_its_face_and_over_its_base() {
        let outline = mini();
        let [x, y] = [0.4 * outline.width, -0.3 * outline.length];
        let top = outline.height(x, y);
        let contains = |x: f64, y: f64, z: f64| outline.contains(&Point3::new(x, y, z));
        assert!(top < -1e-5 && contains(x, y, top - 1e-9) && !contains(x, y, top + 1e-9));
        assert!(contains(x, y, 1e-9 - outline.thickness));
        assert!(!contains(x, y, -1e-9 - outline.thickness));
        assert!(
            !contains(0.6 * outline.width, y, -1e-3) && !contains(x, 0.6 * outline.length, -1e-3)
        );
    }

    #[test]
    fn corners_that_are_too_low_are_mended_by_the_numbers_that_the_message_names() {
        let message = |outline: PadOutline| outline.validated().unwrap_err().to_string();
        let named = |message: &str, before: &str| -> f64 {
            let (_, rest) = message.split_once(before).unwrap_or_else(|| panic!("{message}"));
            rest.split(" m").next().unwrap().parse().unwrap()
        };
        let thin = PadOutline { thickness: 0.0005, ..mini() };
        let found = message(thin);
        let expected = "thickness: found 0.0005 m, expected more than ";
        let falls = "by 0.000405 m by radius_across, 0.000380 m by radius_along and 0.000856 m by";
        assert!(found.starts_with(expected) && found.contains(falls), "{found}");
        let thickness = named(&found, expected) + 1e-9;
        assert!(PadOutline { thickness, ..thin }.validated().is_ok(), "{found}");
        // The crown alone leaves corners, and the rim takes them.
        let rimmed = PadOutline { thickness: 0.0013, ..mini() };
        let found = message(rimmed);
        let expected = "rim_width: found 0.00287 m, expected less than ";
        assert!(found.starts_with(expected), "{found}");
        let rim_width = named(&found, expected) - 1e-9;
        assert!(PadOutline { rim_width, ..rimmed }.validated().is_ok(), "{found}");
        let thickness = named(&found, "a thickness of more than ") + 1e-9;
        assert!(PadOutline { thickness, ..rimmed }.validated().is_ok(), "{found}");
        let wider = PadOutline { rim_width: rim_width + 1e-5, ..rimmed };
        assert!(message(wider).starts_with("rim_width"), "{rim_width} m is not the most");
    }

    #[test]
    fn the_tilt_turns_upwards_to_the_normal_of_the_face() {
        const STEP: f64 = 1e-7;
        for outline in [mini(), PadOutline::flat(0.02525, 0.02075, 0.004)] {
            let height = |x: f64, y: f64| outline.height(x, y);
            for [x, y] in
                [[0.0, 0.0], [3e-3, -2e-3], [-9e-3, 1e-3], [8.5e-3, 11e-3], [1e-3, -12e-3]]
            {
                let slope = [
                    (height(x + STEP, y) - height(x - STEP, y)) / (2.0 * STEP),
                    (height(x, y + STEP) - height(x, y - STEP)) / (2.0 * STEP),
                ];
                let normal = Vector3::new(-slope[0], -slope[1], 1.0).normalize();
                let tilt = outline.tilt(x, y);
                let off = (tilt * Vector3::z() - normal).norm();
                assert!(off < 1e-7, "{off} from the normal at ({x}, {y})");
                assert!((tilt * tilt.transpose() - Matrix3::identity()).norm() < 1e-12);
                // By the shortest way: about an axis in the plane.
                assert!((tilt[(0, 1)] - tilt[(1, 0)]).abs() < 1e-15, "{tilt}");
            }
        }
    }
}
