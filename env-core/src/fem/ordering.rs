//! Fill-reducing order of the nodes for the sparse factorisation.
//!
//! Nested dissection by geometry (George 1973): the nodes are halved across their longest extent,
//! the nodes of one half that touch the other half are the separator and come last, and both
//! halves are ordered the same way.

use nalgebra::Point3;

/// Size of the largest set that is not divided.
const LEAF: usize = 12;

/// `nodes` in elimination order. `neighbours[node]` lists the nodes coupled to it.
pub(super) fn nested_dissection(
    nodes: &[u32],
    places: &[Point3<f64>],
    neighbours: &[Vec<u32>],
) -> Vec<u32> {
    let mut order = Vec::with_capacity(nodes.len());
    let mut side = vec![Side::Outside; places.len()];
    divide(nodes.to_vec(), places, neighbours, &mut side, &mut order);
    order
}

#[derive(Clone, Copy, PartialEq)]
enum Side {
    Outside,
    Low,
    High,
}

fn divide(
    mut nodes: Vec<u32>,
    places: &[Point3<f64>],
    neighbours: &[Vec<u32>],
    side: &mut [Side],
    order: &mut Vec<u32>,
) {
    if nodes.len() <= LEAF {
        order.extend(nodes);
        return;
    }
    let axis = longest_axis(&nodes, places);
    let middle = nodes.len() / 2;
    let along = |node: &u32| (places[*node as usize][axis], *node);
    nodes.sort_by(|a, b| along(a).partial_cmp(&along(b)).expect("coordinates are finite"));
    let (low, high) = nodes.split_at(middle);
    for (half, name) in [(low, Side::Low), (high, Side::High)] {
        for &node in half {
            side[node as usize] = name;
        }
    }
    let touches =
        |node: &u32, other| neighbours[*node as usize].iter().any(|&n| side[n as usize] == other);
    let (low_edge, low_rest): (Vec<u32>, Vec<u32>) =
        low.iter().partition(|node| touches(node, Side::High));
    let (high_edge, high_rest): (Vec<u32>, Vec<u32>) =
        high.iter().partition(|node| touches(node, Side::Low));
    for &node in &nodes {
        side[node as usize] = Side::Outside;
    }
    let (low, high, separator) = if low_edge.len() <= high_edge.len() {
        (low_rest, high.to_vec(), low_edge)
    } else {
        (low.to_vec(), high_rest, high_edge)
    };
    divide(low, places, neighbours, side, order);
    divide(high, places, neighbours, side, order);
    order.extend(separator);
}

fn longest_axis(nodes: &[u32], places: &[Point3<f64>]) -> usize {
    let first = places[nodes[0] as usize];
    let (low, high) = nodes.iter().fold((first, first), |(low, high), &node| {
        (low.inf(&places[node as usize]), high.sup(&places[node as usize]))
    });
    (high - low).imax()
}
