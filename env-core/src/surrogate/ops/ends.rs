//! Combination of an edge with its two ends: relu(eₛᵣ + aₛ + bᵣ).
//!
//! A linear layer on the concatenation (e, vₛ, vᵣ) is a sum of three linear layers. Those of the
//! ends are computed once per node and gathered here.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp3, Layout, Result, Shape, Tensor};

use super::{Edges, numbers, with_numbers};

struct Ends(Arc<Edges>);

/// Returns relu(e + a + b) (E, H) of `edges` (E, H), `senders` (V, H) at the sender and `receivers`
/// (V, H) at the receiver of each edge.
pub(in super::super) fn ends(
    edges: &Tensor,
    senders: &Tensor,
    receivers: &Tensor,
    graph: &Arc<Edges>,
) -> Result<Tensor> {
    let (senders, receivers) = (senders.contiguous()?, receivers.contiguous()?);
    edges.contiguous()?.apply_op3(&senders, &receivers, Ends(Arc::clone(graph)))
}

impl CustomOp3 for Ends {
    fn name(&self) -> &'static str {
        "ends"
    }

    fn cpu_fwd(
        &self,
        edges: &CpuStorage,
        edges_layout: &Layout,
        senders: &CpuStorage,
        senders_layout: &Layout,
        receivers: &CpuStorage,
        receivers_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let width = edges_layout.shape().dims2()?.1;
        let mut sums = numbers(edges, edges_layout)?.to_vec();
        let (senders, receivers) =
            (numbers(senders, senders_layout)?, numbers(receivers, receivers_layout)?);
        for (receiver, range) in self.0.receivers() {
            let own = &receivers[receiver * width..][..width];
            for edge in range {
                let sent = &senders[self.0.senders[edge] as usize * width..][..width];
                let sum = &mut sums[edge * width..][..width];
                for ((sum, sent), own) in sum.iter_mut().zip(sent).zip(own) {
                    *sum = (*sum + sent + own).max(0.0);
                }
            }
        }
        Ok((CpuStorage::F32(sums), edges_layout.shape().clone()))
    }

    fn bwd(
        &self,
        edges: &Tensor,
        senders: &Tensor,
        receivers: &Tensor,
        sums: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let width = edges.dims2()?.1;
        let mut by_sender = vec![0.0; senders.elem_count()];
        let mut by_receiver = vec![0.0; receivers.elem_count()];
        let mut by_edge = vec![0.0; edges.elem_count()];
        with_numbers([sums, gradient], |[sums, gradient]| {
            for (i, passed) in by_edge.iter_mut().enumerate() {
                *passed = if sums[i] > 0.0 { gradient[i] } else { 0.0 };
            }
            Ok(())
        })?;
        for (receiver, range) in self.0.receivers() {
            let own = &mut by_receiver[receiver * width..][..width];
            for edge in range {
                let passed = &by_edge[edge * width..][..width];
                let sent = &mut by_sender[self.0.senders[edge] as usize * width..][..width];
                for ((sent, own), passed) in sent.iter_mut().zip(own.iter_mut()).zip(passed) {
                    *sent += passed;
                    *own += passed;
                }
            }
        }
        let tensor = |values, of: &Tensor| Tensor::from_vec(values, of.shape(), of.device());
        Ok((
            Some(tensor(by_edge, edges)?),
            Some(tensor(by_sender, senders)?),
            Some(tensor(by_receiver, receivers)?),
        ))
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
    fn they_are_gathered_and_added() {
        let (e, a, b) = (random(&[3, 4], 1), random(&[3, 4], 2), random(&[3, 4], 3));
        let rows = |x: &Tensor, rows: [u32; 3]| {
            x.index_select(&Tensor::new(&rows, &Device::Cpu).unwrap(), 0).unwrap()
        };
        let plain = ((e.as_tensor() + rows(&a, [1, 2, 0])).unwrap() + rows(&b, [0, 0, 2])).unwrap();
        let own = ends(&e, &a, &b, &graph()).unwrap();
        assert!(largest_difference(&own, &plain.relu().unwrap()) < 1e-6);
    }

    #[test]
    fn their_derivatives_are_those_of_finite_differences() {
        let inputs = [random(&[3, 4], 1), random(&[3, 4], 2), random(&[3, 4], 3)];
        check_derivatives(&inputs, || ends(&inputs[0], &inputs[1], &inputs[2], &graph()));
    }
}
