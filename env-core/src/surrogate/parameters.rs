//! Trainable parameters of a network, by name.

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use candle_core::{DType, Device, Result, Shape, Tensor, Var, bail};
use candle_nn::{Init, VarBuilder, init::NormalOrUniform, var_builder::SimpleBackend};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Shapes and values of tensors by name.
pub(super) type Vectors = BTreeMap<String, (Vec<usize>, Vec<f32>)>;

/// Variables by name: initialised from a seed when a network is built, or read from a file.
#[derive(Clone)]
pub(super) struct Parameters(Arc<Mutex<Store>>);

struct Store {
    variables: BTreeMap<String, Var>,
    /// Random generator for new variables; `None` if all are given.
    random: Option<ChaCha8Rng>,
}

impl Parameters {
    /// Creates an empty set whose variables are initialised from `seed` on demand.
    pub(super) fn drawn(seed: u64) -> Self {
        let random = Some(ChaCha8Rng::seed_from_u64(seed));
        Self(Arc::new(Mutex::new(Store { variables: BTreeMap::new(), random })))
    }

    /// Creates a set of the given variables and no others.
    pub(super) fn given(tensors: Vectors) -> Result<Self> {
        let variable = |(name, (shape, values)): (String, (Vec<usize>, Vec<f32>))| {
            Ok((name, Var::from_vec(values, shape, &Device::Cpu)?))
        };
        let variables = tensors.into_iter().map(variable).collect::<Result<_>>()?;
        Ok(Self(Arc::new(Mutex::new(Store { variables, random: None }))))
    }

    /// Builder from which a network takes its variables.
    pub(super) fn builder(&self) -> VarBuilder<'static> {
        VarBuilder::from_backend(Box::new(self.clone()), DType::F32, Device::Cpu)
    }

    /// All variables with their names, sorted by name.
    pub(super) fn all(&self) -> Vec<(String, Var)> {
        self.store().variables.iter().map(|(name, var)| (name.clone(), var.clone())).collect()
    }

    /// Shapes and values of all variables.
    pub(super) fn vectors(&self) -> Result<Vectors> {
        let vector = |(name, variable): (String, Var)| {
            let values = variable.flatten_all()?.to_vec1()?;
            Ok((name, (variable.dims().to_vec(), values)))
        };
        self.all().into_iter().map(vector).collect()
    }

    /// Total number of parameters.
    pub(super) fn count(&self) -> usize {
        self.store().variables.values().map(|variable| variable.elem_count()).sum()
    }

    fn store(&self) -> MutexGuard<'_, Store> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl SimpleBackend for Parameters {
    fn get(
        &self,
        shape: Shape,
        name: &str,
        init: Init,
        _dtype: DType,
        device: &Device,
    ) -> Result<Tensor> {
        let mut store = self.store();
        if let Some(known) = store.variables.get(name) {
            if known.shape() != &shape {
                bail!("{name}: found shape {:?}, expected {shape:?}", known.shape());
            }
            return Ok(known.as_tensor().clone());
        }
        let Some(random) = &mut store.random else { bail!("{name}: missing from the weights") };
        let values = draw(&shape, init, random);
        let variable = Var::from_vec(values, shape, device)?;
        let tensor = variable.as_tensor().clone();
        store.variables.insert(name.to_owned(), variable);
        Ok(tensor)
    }

    fn get_unchecked(&self, name: &str, _dtype: DType, _device: &Device) -> Result<Tensor> {
        let found = self.store().variables.get(name).map(|known| known.as_tensor().clone());
        found.map_or_else(|| bail!("{name}: missing from the weights"), Ok)
    }

    fn contains_tensor(&self, name: &str) -> bool {
        self.store().variables.contains_key(name)
    }
}

/// Draws initial values according to `init`; normal distributions are replaced by uniform ones with
/// the same deviation.
fn draw(shape: &Shape, init: Init, random: &mut ChaCha8Rng) -> Vec<f32> {
    let (low, high) = match init {
        Init::Const(value) => (value, value),
        Init::Uniform { lo, up } => (lo, up),
        Init::Randn { mean, stdev } => {
            (mean - 3.0_f64.sqrt() * stdev, mean + 3.0_f64.sqrt() * stdev)
        }
        Init::Kaiming {
            dist: NormalOrUniform::Normal | NormalOrUniform::Uniform,
            fan,
            non_linearity,
        } => {
            let bound = non_linearity.gain() * (3.0 / fan.for_shape(shape) as f64).sqrt();
            (-bound, bound)
        }
    };
    let mut number = || (low + (high - low) * random.random::<f64>()) as f32;
    (0..shape.elem_count()).map(|_| number()).collect()
}
