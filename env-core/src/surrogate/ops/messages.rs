//! Sums of messages over the neighbours of every node.
//!
//! mᵣ = Σₛ relu(aₛ + bᵣ + eₛᵣ): a message of one hidden layer, whose parts for sender, receiver and
//! edge are computed at the nodes and edges. A second linear layer of the message is applied after
//! the sum, which is the same function and costs one product per node.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp2, Layout, Result, Shape, Tensor};

use super::{numbers, with_numbers};
use crate::simd::LANES;

/// Directed edges sorted by receiver.
#[derive(Clone, Debug, PartialEq)]
pub(in super::super) struct Edges {
    /// Sender of each edge (E).
    pub(in super::super) senders: Vec<u32>,
    /// Index of the first edge of each receiver, and the number of edges (V + 1).
    pub(in super::super) starts: Vec<u32>,
}

impl Edges {
    /// Receivers with the range of their edges.
    #[inline(always)]
    pub(super) fn receivers(&self) -> impl Iterator<Item = (usize, std::ops::Range<usize>)> {
        let ranges = self.starts.windows(2).map(|pair| pair[0] as usize..pair[1] as usize);
        ranges.enumerate()
    }

    /// Number of nodes.
    pub(super) fn nodes(&self) -> usize {
        self.starts.len() - 1
    }
}

struct Messages(Arc<Edges>);

/// Returns the summed messages (B V, H) of `nodes` (B V, 2 H), whose rows hold the sender's part
/// and then the receiver's, along edges with the part `edges` (E, H), the same for all presses.
pub(in super::super) fn messages(
    nodes: &Tensor,
    edges: &Tensor,
    graph: &Arc<Edges>,
) -> Result<Tensor> {
    nodes.contiguous()?.apply_op2(edges, Messages(Arc::clone(graph)))
}

impl CustomOp2 for Messages {
    fn name(&self) -> &'static str {
        "messages"
    }

    fn cpu_fwd(
        &self,
        nodes: &CpuStorage,
        nodes_layout: &Layout,
        edges: &CpuStorage,
        edges_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let width = edges_layout.shape().dims2()?.1;
        let rows = nodes_layout.shape().dims2()?.0;
        let (nodes, edges) = (numbers(nodes, nodes_layout)?, numbers(edges, edges_layout)?);
        let mut sums = vec![0.0; rows * width];
        let presses = nodes.chunks_exact(2 * width * self.0.nodes());
        for (nodes, sums) in presses.zip(sums.chunks_exact_mut(width * self.0.nodes())) {
            hear(&self.0, nodes, 2 * width, edges, width, sums);
        }
        Ok((CpuStorage::F32(sums), (rows, width).into()))
    }

    fn bwd(
        &self,
        nodes: &Tensor,
        edges: &Tensor,
        _sums: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let width = edges.dims2()?.1;
        let count = self.0.nodes();
        let (mut dnodes, mut dedges) =
            (vec![0.0; nodes.elem_count()], vec![0.0; edges.elem_count()]);
        with_numbers([nodes, edges, gradient], |[nodes, edges, gradient]| {
            let presses = nodes.chunks_exact(2 * width * count);
            let gradients = gradient.chunks_exact(width * count);
            for ((nodes, gradient), dnodes) in
                presses.zip(gradients).zip(dnodes.chunks_exact_mut(2 * width * count))
            {
                back(&self.0, nodes, edges, gradient, dnodes, &mut dedges);
            }
            Ok(())
        })?;
        let tensor = |values, of: &Tensor| Tensor::from_vec(values, of.shape(), of.device());
        Ok((Some(tensor(dnodes, nodes)?), Some(tensor(dedges, edges)?)))
    }
}

/// Sets `sums` (V, H) to the messages of one press. A row of `nodes` is `stride` long and begins
/// with the sender's and the receiver's part.
#[inline(always)]
pub(in super::super) fn hear(
    graph: &Edges,
    nodes: &[f32],
    stride: usize,
    edges: &[f32],
    width: usize,
    sums: &mut [f32],
) {
    for (receiver, range) in graph.receivers() {
        let own = &nodes[receiver * stride + width..][..width];
        let (own, own_rest) = own.as_chunks::<LANES>();
        let (sum, sum_rest) = sums[receiver * width..][..width].as_chunks_mut::<LANES>();
        // Sums of a part of the row stay in a register.
        for (part, (sum, own)) in sum.iter_mut().zip(own).enumerate() {
            let mut heard = [0.0_f32; LANES];
            for edge in range.clone() {
                let sent = graph.senders[edge] as usize * stride + LANES * part;
                let sent: &[f32; LANES] = nodes[sent..].first_chunk().expect("a part of a row");
                let edge = edge * width + LANES * part;
                let edge: &[f32; LANES] = edges[edge..].first_chunk().expect("a part of a row");
                for i in 0..LANES {
                    heard[i] += (sent[i] + own[i] + edge[i]).max(0.0);
                }
            }
            *sum = heard;
        }
        let first = width - sum_rest.len();
        for (i, (sum, own)) in (first..).zip(sum_rest.iter_mut().zip(own_rest)) {
            let heard = |edge: usize| {
                let sent = nodes[graph.senders[edge] as usize * stride + i];
                (sent + own + edges[edge * width + i]).max(0.0)
            };
            *sum = range.clone().map(heard).sum();
        }
    }
}

fn back(
    graph: &Edges,
    nodes: &[f32],
    edges: &[f32],
    gradient: &[f32],
    dnodes: &mut [f32],
    dedges: &mut [f32],
) {
    let width = gradient.len() / graph.nodes();
    let mut heard = vec![0.0; width];
    for (receiver, range) in graph.receivers() {
        let own = &nodes[(2 * receiver + 1) * width..][..width];
        let gradient = &gradient[receiver * width..][..width];
        heard.fill(0.0);
        for edge in range {
            let sender = 2 * graph.senders[edge] as usize * width;
            let sent = &nodes[sender..][..width];
            let dsent = &mut dnodes[sender..][..width];
            let (edge, dedge) =
                (&edges[edge * width..][..width], &mut dedges[edge * width..][..width]);
            for i in 0..width {
                let passed = if sent[i] + own[i] + edge[i] > 0.0 { gradient[i] } else { 0.0 };
                dsent[i] += passed;
                dedge[i] += passed;
                heard[i] += passed;
            }
        }
        let down = &mut dnodes[(2 * receiver + 1) * width..][..width];
        down.iter_mut().zip(&heard).for_each(|(down, heard)| *down += heard);
    }
}

#[cfg(test)]
mod tests {
    use candle_core::Device;

    use super::{super::tests::*, *};

    /// Graph in which 0 receives from 1 and 2, 1 from none, 2 from 0.
    fn graph() -> Arc<Edges> {
        Arc::new(Edges { senders: vec![1, 2, 0], starts: vec![0, 2, 2, 3] })
    }

    #[test]
    fn they_are_gathered_and_added_up() {
        let (nodes, edges) = (random(&[6, 8], 1), random(&[3, 4], 2));
        let index = |rows: [u32; 6]| Tensor::new(&rows, &Device::Cpu).unwrap();
        let (from, to) = (index([1, 2, 0, 4, 5, 3]), index([0, 0, 2, 3, 3, 5]));
        let part = |first: usize, rows: &Tensor| {
            nodes.narrow(1, first, 4).unwrap().contiguous().unwrap().index_select(rows, 0).unwrap()
        };
        let edge = Tensor::cat(&[edges.as_tensor(), edges.as_tensor()], 0).unwrap();
        let heard = ((part(0, &from) + part(4, &to)).unwrap() + edge).unwrap().relu().unwrap();
        let plain = Tensor::zeros((6, 4), heard.dtype(), &Device::Cpu).unwrap();
        let plain = plain.index_add(&to, &heard, 0).unwrap();
        let own = messages(&nodes, &edges, &graph()).unwrap();
        assert!(largest_difference(&own, &plain) < 1e-6);
    }

    #[test]
    fn their_derivatives_are_those_of_finite_differences() {
        let inputs = [random(&[6, 8], 1), random(&[3, 4], 2)];
        check_derivatives(&inputs, || messages(&inputs[0], &inputs[1], &graph()));
    }
}
