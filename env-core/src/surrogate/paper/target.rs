//! Loss of the paper's networks: the corrector's relative errors of displacement and stress, and in
//! addition those of the object's motion, where the input is a force, and of the rigid motion,
//! where it is output. Light presses count less than with the corrector.

use candle_core::{Device, Tensor};
use candle_nn::VarBuilder;
use nalgebra::Point3;

use super::{
    card::PaperCard,
    config::{Input, PaperConfig},
    gels::{Pad, PaperGels},
    network::{DISPLACEMENT, Paper, PaperOutput, STRESS},
    patch::PaperPatch,
    rigid::{self, STILL},
    samples::PaperSample,
    scene::{PaperPush, PaperScene},
};
use crate::{
    Error, Result,
    surrogate::{
        features::{Fields, Target},
        loss::relative,
        material::PadMaterial,
        parameters::Parameters,
        train::{Loss, Network, mirror_signs},
        weights,
    },
};

/// Weight of displacement, stress, the object's motion and the rigid motion in the loss.
const WEIGHTS: [f64; 4] = [1.0, 1.0, 1.0, 0.1];

/// Size of a press below which it counts less, relative to a typical one.
const LIGHT: f64 = 0.1;

/// A network and the kind of its input.
pub(super) struct TrainablePaper {
    network: Paper,
    pub(super) input: Input,
}

impl TrainablePaper {
    /// Reads a network and its card from the `bytes` of weights called `name`.
    pub(super) fn opened(name: &str, bytes: &[u8]) -> Result<(Self, PaperCard)> {
        let (tensors, card): (_, PaperCard) = weights::of_kind(name, bytes)?;
        card.network.validated().map_err(|error| Error::file(name, error))?;
        let network = Self::new(&card.network, &Parameters::given(tensors)?.builder());
        // Only the first line, since a trace may follow.
        let network = network.map_err(|error| {
            Error::file(name, error.to_string().lines().next().unwrap_or_default())
        })?;
        Ok((network, card))
    }

    /// Computes the answer to a sample seen in a mirror.
    pub(super) fn output(
        &self,
        gels: &PaperGels,
        sample: &PaperSample,
        mirror: usize,
    ) -> Result<PaperOutput> {
        let pad = &gels.pads[sample.gel];
        let scene = PaperScene::new(pad, &sample.patch, sample.push(self.input), mirror)?;
        Ok(self.network.forward(&scene)?)
    }

    /// Computes the answer to `push` by the surface in `patch`.
    pub(super) fn answer_to(
        &self,
        pad: &Pad,
        patch: &PaperPatch,
        push: PaperPush,
    ) -> Result<PaperOutput> {
        Ok(self.network.forward(&PaperScene::new(pad, patch, push, 0)?)?)
    }

    /// Returns whether it outputs a rigid motion.
    pub(super) fn has_motion(&self) -> bool {
        self.network.has_motion()
    }

    /// Errors of the parts of an answer, a scalar each; `None` for parts that are not in the loss.
    fn errors(
        &self,
        gels: &PaperGels,
        sample: &PaperSample,
        mirror: usize,
    ) -> Result<[Option<Tensor>; 4]> {
        let answer = self.output(gels, sample, mirror)?;
        let signs = mirror_signs(mirror).map(|sign| sign as f32);
        let error = |found: &Tensor, target: Vec<f32>, middling: f64| -> Result<Option<Tensor>> {
            let weight = weight(&target, middling);
            let target = Tensor::from_vec(target, (1, found.elem_count()), &Device::Cpu)?;
            let error = relative(&found.reshape(target.shape())?, &target)?.mean_all()?;
            Ok(Some((error * weight)?))
        };
        let mirrored = |vectors: &[f32]| -> Vec<f32> {
            vectors.iter().zip(signs.iter().cycle()).map(|(x, sign)| x * sign).collect()
        };
        let object = match self.input {
            Input::Translation => None,
            Input::Force => error(&answer.object, mirrored(&motion(gels, sample)), DISPLACEMENT)?,
        };
        let rigid = match &answer.rigid {
            Some(found) => rigid_error(found, &sample.rigid, signs).map(Some)?,
            None => None,
        };
        Ok([
            error(&answer.displacement, mirrored(&sample.target.displacement), DISPLACEMENT)?,
            error(&answer.stress, sample.target.stress.clone(), STRESS)?,
            object,
            rigid,
        ])
    }
}

/// Weight of the relative error of a field: 1 where its root mean square is that of a typical
/// press, in proportion to its size where it is far below a tenth of that. First touches, which the
/// surface's nodes hardly resolve, would otherwise dominate the loss.
fn weight(target: &[f32], middling: f64) -> f64 {
    let squares = target.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>();
    let size = (squares / target.len() as f64).sqrt();
    size / size.hypot(LIGHT * middling)
}

/// Motion of the object's nodes since it touched (O, 3), in units of thickness.
pub(super) fn motion(gels: &PaperGels, sample: &PaperSample) -> Vec<f32> {
    let length = gels.pads[sample.gel].gel.thickness;
    let moved = sample.patch.places.iter().map(|p| (sample.moved * Point3::from(*p)).coords - p);
    moved.flat_map(|u| [u.x, u.y, u.z]).map(|x| (x / length) as f32).collect()
}

/// ‖M̂ − M‖ / ‖M − 1‖ of a rigid motion M = (R, t) in a mirror of the given `signs`.
fn rigid_error(found: &Tensor, target: &[f32], signs: [f32; 3]) -> Result<Tensor> {
    let sign = |i: usize| if i < 9 { signs[i / 3] * signs[i % 3] } else { signs[i - 9] };
    let change: Vec<f32> = (0..target.len()).map(|i| target[i] * sign(i) - STILL[i]).collect();
    let row = |numbers: Vec<f32>| Tensor::from_vec(numbers, (1, target.len()), &Device::Cpu);
    let found = (found.reshape((1, target.len()))? - row(STILL.to_vec())?)?;
    Ok(relative(&found, &row(change)?)?.mean_all()?)
}

impl Network for TrainablePaper {
    type Config = PaperConfig;
    type Sample = PaperSample;
    type Ground = PaperGels;

    fn new(config: &PaperConfig, vb: &VarBuilder) -> candle_core::Result<Self> {
        Ok(Self { network: Paper::new(config, vb)?, input: config.input })
    }

    fn graph(_sample: &PaperSample) -> usize {
        0
    }

    fn target<'a>(gels: &'a PaperGels, sample: &'a PaperSample) -> (&'a Target, &'a PadMaterial) {
        (&sample.target, &gels.pads[sample.gel].gel)
    }

    fn loss(&self, gels: &PaperGels, samples: &[&PaperSample], mirror: usize) -> Result<Loss> {
        let mut total = Tensor::zeros((), candle_core::DType::F32, &Device::Cpu)?;
        let mut parts = [0.0; 4];
        for sample in samples {
            let errors = self.errors(gels, sample, mirror)?;
            for (i, error) in errors.iter().enumerate() {
                if let Some(error) = error {
                    total = (total + (error * (WEIGHTS[i] / samples.len() as f64))?)?;
                    parts[i] += error.to_scalar::<f32>()? / samples.len() as f32;
                }
            }
        }
        Ok(Loss { total, parts })
    }

    fn answer(&self, gels: &PaperGels, sample: &PaperSample) -> Result<Fields> {
        fields(&self.output(gels, sample, 0)?)
    }
}

/// Fields for evaluation; contact forces are not output.
pub(super) fn fields(answer: &PaperOutput) -> Result<Fields> {
    Ok(Fields {
        displacement: answer.displacement.flatten_all()?.to_vec1()?,
        stress: answer.stress.to_vec1()?,
        forces: vec![f32::NAN],
        force: [f32::NAN; 3],
    })
}

/// Distance of a network's rigid motion of the gel from the best fit: angle (rad), and distance in
/// units of thickness.
pub(super) fn rigid_apart(answer: &PaperOutput, sample: &PaperSample) -> Result<Option<[f64; 2]>> {
    let found = answer.rigid.as_ref().map(Tensor::to_vec1::<f32>).transpose()?;
    Ok(found.map(|found| rigid::apart(&found, &sample.rigid)))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::{super::samples::tests::pressed_ball, *};
    use crate::surrogate::{
        adam::{self, Adam},
        metrics,
        parameters::Parameters,
    };

    #[test]
    #[ignore = "minutes: cargo test --lib one_press_is_learnt_by_heart -- --ignored"]
    fn one_press_is_learnt_by_heart() {
        let (gels, sample) = pressed_ball();
        let config = PaperConfig { width: 32, rounds: 3, ..PaperConfig::default() };
        let (parameters, mut adam) = (Parameters::drawn(0), Adam::default());
        let network = TrainablePaper::new(&config, &parameters.builder()).unwrap();
        let (variables, steps) = (parameters.all(), 4000);
        for step in 0..steps {
            let loss = network.loss(&gels, &[&sample], 0).unwrap();
            let gradients = adam::gradients(&variables, &loss.total.backward().unwrap()).unwrap();
            let (gradient, _) = adam::mean(&[gradients], 1.0);
            let rate = 4e-3 * (1.0 + (PI * f64::from(step) / f64::from(steps)).cos());
            adam.step(&variables, &gradient, rate).unwrap();
        }
        let (target, gel) = TrainablePaper::target(&gels, &sample);
        let found = metrics::errors(&network.answer(&gels, &sample).unwrap(), target, gel);
        let (u, stress) = (found.displacement, found.stress);
        assert!(u < 5e-3 && stress < 5e-3, "u misses by {u}, stress by {stress} in {steps} steps");
    }
}
