//! Adam (Kingma and Ba 2015) with decoupled weight decay (Loshchilov and Hutter 2019), with a state
//! that can be saved.

use std::collections::BTreeMap;

use candle_core::{Result, Tensor, Var, backprop::GradStore};

/// State of the optimiser.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Adam {
    /// Steps taken.
    pub(super) steps: u64,
    /// First and second moments of each variable's gradient.
    pub(super) moments: BTreeMap<String, [Vec<f32>; 2]>,
}

const BETAS: [f64; 2] = [0.9, 0.99];
const EPSILON: f64 = 1e-8;
/// Share of a weight that decays in a step at learning rate 1; biases and norm layers do not decay.
const DECAY: f64 = 1e-2;

/// Gradients by variable.
pub(super) type Gradients = BTreeMap<String, Vec<f32>>;

/// Gradients of `variables`; zero where the loss does not depend on a variable.
pub(super) fn gradients(variables: &[(String, Var)], store: &GradStore) -> Result<Gradients> {
    let gradient = |(name, variable): &(String, Var)| {
        let values = match store.get(variable) {
            Some(gradient) => gradient.flatten_all()?.to_vec1()?,
            None => vec![0.0; variable.elem_count()],
        };
        Ok((name.clone(), values))
    };
    variables.iter().map(gradient).collect()
}

/// Mean of several gradients, scaled down to a norm of at most `most`, and its norm before that.
pub(super) fn mean(all: &[Gradients], most: f64) -> (Gradients, f64) {
    let mut sum = all[0].clone();
    for other in &all[1..] {
        for (name, values) in &mut sum {
            values.iter_mut().zip(&other[name]).for_each(|(sum, g)| *sum += g);
        }
    }
    let squares = sum.values().flatten().map(|g| f64::from(*g).powi(2)).sum::<f64>();
    let norm = squares.sqrt() / all.len() as f64;
    let factor = (most / norm).min(1.0) / all.len() as f64;
    sum.values_mut().flatten().for_each(|g| *g *= factor as f32);
    (sum, norm)
}

impl Adam {
    /// Performs one step of `variables` against `gradients` at learning rate `rate`.
    pub(super) fn step(
        &mut self,
        variables: &[(String, Var)],
        gradients: &Gradients,
        rate: f64,
    ) -> Result<()> {
        self.steps += 1;
        let correction = BETAS.map(|beta| 1.0 - beta.powf(self.steps as f64));
        for (name, variable) in variables {
            let gradient = &gradients[name];
            let zero = || [vec![0.0; gradient.len()], vec![0.0; gradient.len()]];
            let [first, second] = self.moments.entry(name.clone()).or_insert_with(zero);
            let decay = if variable.rank() > 1 { rate * DECAY } else { 0.0 };
            let mut values: Vec<f32> = variable.flatten_all()?.to_vec1()?;
            for (i, g) in gradient.iter().enumerate() {
                first[i] += (1.0 - BETAS[0]) as f32 * (g - first[i]);
                second[i] += (1.0 - BETAS[1]) as f32 * (g * g - second[i]);
                let scale = (f64::from(second[i]) / correction[1]).sqrt() + EPSILON;
                let step = f64::from(first[i]) / correction[0] / scale;
                values[i] -= (rate * step + decay * f64::from(values[i])) as f32;
            }
            variable.set(&Tensor::from_vec(values, variable.shape(), variable.device())?)?;
        }
        Ok(())
    }
}
