//! Slopes of a height map beside pixels that were lowered to an object.
//!
//! Shapes: P pixels, those across the fastest.

use std::ops::Range;

use super::face::PlanGrid;

/// Largest slope of the gel beside an object's edge, of which the nodes of the mesh say nothing.
const STEEPEST: f64 = 2.0;

/// Lowers `heights` (P) in m around pixels that lie below the `free` surface (P), so that they rise
/// from them with a slope of [`STEEPEST`] at most, beside steeper walls of the object, too.
pub(super) fn ease(heights: &mut [f64], free: &[f64], grid: &PlanGrid) {
    let Some([columns, rows]) = window(heights, free, grid) else { return };
    let width = columns.len();
    let pixels: Vec<_> =
        rows.flat_map(|j| columns.clone().map(move |i| j * grid.counts[0] as usize + i)).collect();
    let lowered = |&pixel: &usize| heights[pixel] < free[pixel];
    let start = |pixel: &usize| if lowered(pixel) { heights[*pixel] } else { f64::INFINITY };
    let mut limits: Vec<_> = pixels.iter().map(start).collect();
    spread(&mut limits, width, grid.cell);
    for (pixel, limit) in pixels.into_iter().zip(limits) {
        heights[pixel] = heights[pixel].min(limit);
    }
}

/// Columns and rows that slopes of [`STEEPEST`] from lowered pixels may reach; `None` if the pixels
/// beside them stand no higher.
fn window(heights: &[f64], free: &[f64], grid: &PlanGrid) -> Option<[Range<usize>; 2]> {
    let counts @ [nx, ny] = grid.counts.map(|count| count as usize);
    let most = grid.cell.map(|cell| STEEPEST * cell);
    let (mut low, mut high, mut drop) = (counts, [0, 0], 0.0f64);
    for j in 0..ny {
        for i in 0..nx {
            let pixel = j * nx + i;
            let height = heights[pixel];
            if height >= free[pixel] {
                continue;
            }
            let step = |is_there: bool, beside: usize, axis: usize| {
                if is_there { heights[beside] - height - most[axis] } else { 0.0 }
            };
            let step = step(i > 0, pixel.wrapping_sub(1), 0)
                .max(step(i + 1 < nx, pixel + 1, 0))
                .max(step(j > 0, pixel.wrapping_sub(nx), 1))
                .max(step(j + 1 < ny, pixel + nx, 1));
            if step > 0.0 {
                low = [low[0].min(i), low[1].min(j)];
                high = [high[0].max(i), high[1].max(j)];
                drop = drop.max(step);
            }
        }
    }
    let part = |axis: usize| {
        // Twice as far as on a level surface, as it rises away from the object.
        let reach = (2.0 * drop / most[axis]).ceil() as usize + 2;
        low[axis].saturating_sub(reach)..(high[axis] + reach + 1).min(counts[axis])
    };
    (drop > 0.0).then(|| [part(0), part(1)])
}

/// Lowers each of `limits` (rows of `width`) to where a slope of [`STEEPEST`] from another ends, by
/// distances along rows, columns and diagonals of pixels of size `cell` (m).
fn spread(limits: &mut [f64], width: usize, [dx, dy]: [f64; 2]) {
    let [along, across, aside] = [dx, dy, dx.hypot(dy)].map(|d| STEEPEST * d);
    for _ in 0..2 {
        for cell in 0..limits.len() {
            let i = cell % width;
            let mut limit = limits[cell];
            if i > 0 {
                limit = limit.min(limits[cell - 1] + along);
            }
            if cell >= width {
                let before = &limits[cell - width - i..cell - i];
                limit = limit.min(before[i] + across);
                limit = limit.min(before[i.saturating_sub(1)] + aside);
                limit = limit.min(before[(i + 1).min(width - 1)] + aside);
            }
            limits[cell] = limit;
        }
        // The second pass runs from the last to the first, and turns them back.
        limits.reverse();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beside_a_step_heights_rise_with_the_steepest_slope() {
        let (grid, drop) = (PlanGrid { counts: [40, 30], cell: [1e-4; 2] }, 1e-3);
        let free = vec![0.0; 1200];
        let is_lowered = |[x, y]: [f64; 2]| x.abs() < 5e-4 && y.abs() < 6e-4;
        let lowered = grid.centres().map(|place| if is_lowered(place) { -drop } else { 0.0 });
        let mut heights: Vec<f64> = lowered.collect();
        ease(&mut heights, &free, &grid);
        for (place @ [x, y], z) in grid.centres().zip(heights) {
            // The outermost lowered centres.
            let [dx, dy] = [x.abs() - 4.5e-4, y.abs() - 5.5e-4].map(|d| d.max(0.0));
            let exact = (STEEPEST * dx.hypot(dy) - drop).min(0.0);
            // Distances along rows, columns and diagonals alone are at most a twelfth too long
            // here.
            let most = STEEPEST * dx.hypot(dy) / 8.0 + 1e-12;
            assert!(z > exact - 1e-12 && z < exact + most, "{z} m for {exact} m at {place:?}");
            assert!(dx > 0.0 && dy > 0.0 || (z - exact).abs() < 1e-12, "{z}, {exact} m");
        }
    }

    #[test]
    fn a_map_without_steps_is_left_alone() {
        let grid = PlanGrid { counts: [40, 30], cell: [1e-4; 2] };
        let ball = |[x, y]: [f64; 2]| 500.0 * (x * x + y * y) - 5e-4;
        let free = vec![0.0; 1200];
        let before: Vec<f64> = grid.centres().map(|place| ball(place).min(0.0)).collect();
        let mut after = before.clone();
        ease(&mut after, &free, &grid);
        assert_eq!(before, after);
    }
}
