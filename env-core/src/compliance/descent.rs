//! Line search along a Newton step on the energy of body and contact.

use nalgebra::Vector3;

use super::balance::{Contact, NewtonStep, Trial, dot};
use crate::contact::Touch;

/// Smallest accepted decrease of the energy, as a fraction of the predicted one (Armijo).
const ARMIJO: f64 = 1e-4;
/// Smallest fraction of a Newton step that is tried.
const SHORTEST: f64 = 1e-3;

impl Contact<'_> {
    /// Halves `step` until the energy decreases enough for its slope (Armijo); `None` if it never
    /// does.
    pub(super) fn line_search(
        &mut self,
        offset: &[Vector3<f64>],
        at: &Trial,
        step: &NewtonStep,
        full: Option<Trial>,
    ) -> Option<Trial> {
        let slope = -dot(&step.displacement, &at.excess);
        if slope >= 0.0 {
            return None;
        }
        let limits = self.friction_limits(&at.touches);
        let energy = self.energy(offset, at, &limits);
        let (mut share, mut next) = (1.0, full);
        while share > SHORTEST {
            if let Some(trial) = next
                && self.energy(offset, &trial, &limits) - energy <= ARMIJO * share * slope
            {
                return Some(trial);
            }
            share *= 0.5;
            next = self.moved(at, step, share);
        }
        None
    }

    /// Energy of body and contact with friction limited to `limits` (J).
    fn energy(&self, offset: &[Vector3<f64>], at: &Trial, limits: &[f64]) -> f64 {
        let give = at.displacement.iter().zip(offset).map(|(u, u0)| u - u0);
        let elastic: f64 = at.forces.iter().zip(give).map(|(f, u)| 0.5 * f.dot(&u)).sum();
        let contact = |touch: &Touch| {
            let point = &self.zone.surface[touch.point as usize];
            let limit = limits.get(self.pair(touch)).copied().unwrap_or(0.0);
            self.law.energy(point, touch, limit) * point.area
        };
        elastic + at.touches.iter().map(contact).sum::<f64>()
    }

    /// Friction limit of every pair of shape and point (Pa); 0 for pairs that do not touch.
    fn friction_limits(&self, touches: &[Touch]) -> Vec<f64> {
        let mut limits = vec![0.0; self.poses.len() * self.zone.surface.len()];
        for touch in touches {
            let point = &self.zone.surface[touch.point as usize];
            limits[self.pair(touch)] = self.law.limit(point, touch);
        }
        limits
    }

    fn pair(&self, touch: &Touch) -> usize {
        touch.shape as usize * self.zone.surface.len() + touch.point as usize
    }
}
