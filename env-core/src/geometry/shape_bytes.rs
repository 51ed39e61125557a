//! Shapes as bytes.

use super::Shape;
use crate::{
    Result,
    saved::{self, Mark},
};

const MARK: Mark = *b"a-shape1";

impl Shape {
    /// Serialises the shape, exact to the bit.
    pub fn to_bytes(&self) -> Vec<u8> {
        saved::to_bytes(MARK, self)
    }

    /// Restores a shape from the result of [`Shape::to_bytes`]; other bytes are an error.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        saved::from_bytes::<Self>(MARK, "shape", bytes)?.validated()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::{Point3, Unit, Vector3};

    use super::*;
    use crate::geometry::{Bump, Hollow, StarShaped, Surface, Wave};

    fn shapes() -> Vec<Shape> {
        let v = Vector3::new(0.01, 0.02, 0.03);
        let waves = vec![Wave { amplitude: 0.1, vector: v, phase: -0.0 }];
        let axis = Unit::new_normalize(v);
        let bumps = vec![Bump { amplitude: -0.1, axis, concentration: 1.0 / 0.3 }];
        let star = StarShaped::new(v, waves).with_bumps(bumps);
        let ball = Shape::Sphere { radius: 0.01 }.surface(16).unwrap();
        let ball = Surface::new("ball", ball.vertices(), ball.triangles()).unwrap();
        let mut shapes = Shape::kinds();
        let rounded: Vec<_> = shapes.iter().filter_map(|shape| shape.rounded(1e-3).ok()).collect();
        shapes.extend(rounded);
        shapes.extend([
            Shape::HalfSpace,
            Shape::StarShaped(star.clone()),
            Shape::Hollow(Hollow::new(star, 0.8)),
            Shape::Mesh(Arc::new(ball)),
        ]);
        // Scaled ones have cores and samples that are not those of their size.
        let others: Vec<_> = shapes.iter().map(|shape| shape.sampled().scaled(0.7)).collect();
        shapes.extend(others);
        shapes
    }

    #[test]
    fn shapes_come_back_from_their_bytes_with_the_same_distances() {
        let points = [[1e-3, -2e-3, 5e-3], [0.011, 0.0, 0.03], [-0.05, 0.2, 0.1]].map(Point3::from);
        for shape in shapes() {
            let again = Shape::from_bytes(&shape.to_bytes()).unwrap();
            assert_eq!(again, shape);
            for point in &points {
                let [found, expected] = [&again, &shape].map(|shape| shape.distance(point));
                assert_eq!(found.value.to_bits(), expected.value.to_bits(), "{}", shape.name());
                assert_eq!(found.normal, expected.normal, "{}", shape.name());
            }
        }
    }

    #[test]
    fn other_bytes_are_refused() {
        let message = |bytes: &[u8]| Shape::from_bytes(bytes).unwrap_err().to_string();
        let good = Shape::Sphere { radius: 0.01 }.to_bytes();
        assert!(message(b"").contains("0 bytes without its mark"));
        assert!(message(&good[..good.len() - 1]).contains("damaged"));
        assert!(message(&[&good[..], b"12"].concat()).contains("2 bytes too many"));
        assert!(message(&Shape::Sphere { radius: -1.0 }.to_bytes()).contains("radius: found -1"));
        let ball = Shape::Sphere { radius: 0.01 }.surface(8).unwrap();
        let open = Surface::from_parts(ball.vertices().to_vec(), ball.triangles()[1..].to_vec());
        assert!(message(&Shape::Mesh(Arc::new(open)).to_bytes()).contains("damaged"));
        // A plane has no samples. The byte after the mark says that the rest is of a sampled shape.
        let is_sampled = |shape: &Shape| matches!(shape.sampled(), Shape::Sampled(_));
        let exact = Shape::kinds().into_iter().find(is_sampled).unwrap();
        let sampled = exact.sampled().to_bytes();
        let of = |shape: Shape| {
            let parts = postcard::to_stdvec(&(shape, 1.0)).unwrap();
            [&sampled[..=MARK.len()], &parts].concat()
        };
        assert_eq!(of(exact), sampled);
        assert!(message(&of(Shape::HalfSpace)).contains("damaged"));
    }
}
