//! What a dataset is made of.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::{
    Error, Result,
    deformation::{Law, Moduli, SoftBody},
    fem::{Element, Fem, Options},
    geometry::{PadMesh, TetMesh},
    objects::{Object, catalogue},
    sensor::Sensor,
};

/// Everything that decides the bytes of a dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// What objects, grasps and perturbations are drawn from.
    pub seed: u64,
    /// What is soft.
    pub scenario: Scenario,
    /// How many objects: of the 63 rigid ones, evenly over the catalogue; or of all 64, those named
    /// `first` before the others.
    pub objects: usize,
    /// Names of the soft objects that come first; if empty, those of [`SOFT`].
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub first: Vec<String>,
    /// Grasps of each object.
    pub grasps: usize,
    /// Frames of growing force in each grasp.
    pub frames: usize,
    /// Nodes of the mesh whose fields are stored.
    pub model_nodes: usize,
    /// Nodes of the mesh that is solved.
    pub truth_nodes: usize,
    /// Element that is solved.
    pub truth_element: String,
    /// Least and greatest force at which a grasp ends (N).
    pub force: [f64; 2],
    /// Closing of each pad at which a grasp ends, whatever its force, over its thickness; or of each
    /// finger, over half the object's width there.
    pub depth: f64,
    /// Greatest shift of the pads against each other along their faces, over their closing.
    pub shear: f64,
    /// Greatest turn of the pads against each other about their normals, over their closing (rad/m).
    pub twist: f64,
    /// Density of rigid objects (kg/m³), whose weight acts along the fingers, away from the wrist; 0
    /// leaves weight out.
    #[serde(skip_serializing_if = "is_zero")]
    pub density: f64,
    /// Materials of what is soft, and the pads or fingers, drawn for each grasp by their shares.
    pub gels: Vec<Gel>,
}

/// Which side of a grasp is soft.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scenario {
    /// Two soft pads, between which a rigid object settles.
    #[default]
    Pads,
    /// A soft object between two rigid fingers with the pads' outlines.
    Soft,
}

/// The first soft objects: solids of six kinds, the strawberry among them. The paper's ablation has
/// six objects and does not name the others.
pub const SOFT: [&str; 6] =
    ["strawberry-1", "lemon-1", "eggplant-1", "sphere-1", "cylinder-1", "cuboid-1"];

/// A soft material and what it is met with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gel {
    /// Name of the sensor whose pads, or fingers with the outline of whose pads, it takes.
    pub sensor: String,
    /// Young's modulus at small strain (Pa).
    pub young: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Coefficient of friction.
    pub friction: f64,
    /// How often it is drawn, relative to the others.
    pub share: f64,
}

impl Default for Config {
    /// The paper's 63 objects × 100 grasps × 50 frames. Three grasps of four are made with the two
    /// published calibrations of the `GelSight` Mini, the others with softer and stiffer gels and
    /// with a second sensor. 80 N is what a strong gripper of this size exerts; below 20 N, one grasp
    /// of twenty-five gets past a third of the gel.
    fn default() -> Self {
        let gel = |sensor: &str, young, poisson, friction, share| Gel {
            sensor: sensor.to_owned(),
            young,
            poisson,
            friction,
            share,
        };
        Self {
            seed: 0,
            scenario: Scenario::Pads,
            objects: 63,
            first: Vec::new(),
            grasps: 100,
            frames: 50,
            model_nodes: 1000,
            truth_nodes: 2000,
            truth_element: "p1-bar".to_owned(),
            force: [2.0, 80.0],
            depth: 0.5,
            shear: 0.4,
            twist: 60.0,
            density: 0.0,
            gels: vec![
                gel("gelsight-mini", 0.30e6, 0.47, 1.0, 5.0),
                gel("gelsight-mini", 0.428e6, 0.475, 0.6, 2.5),
                gel("gelsight-mini", 0.10e6, 0.45, 0.8, 0.75),
                gel("gelsight-mini", 1.0e6, 0.49, 0.4, 0.75),
                gel("digit", 0.30e6, 0.47, 0.8, 1.0),
            ],
        }
    }
}

#[allow(clippy::trivially_copy_pass_by_ref)] // As serde asks.
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// The rigid objects of the catalogue.
const RIGID: usize = 63;

impl Scenario {
    fn objects(self) -> usize {
        match self {
            Self::Pads => RIGID,
            Self::Soft => RIGID + 1,
        }
    }
}

impl Config {
    /// The configuration in a TOML file; what it leaves out is the default.
    pub fn read(path: &Path) -> Result<Self> {
        let file = |reason: String| Error::File { path: path.display().to_string(), reason };
        let text = std::fs::read_to_string(path).map_err(|error| file(error.to_string()))?;
        toml::from_str::<Self>(&text).map_err(|error| file(error.to_string()))?.validated()
    }

    /// The objects of a dataset, in order.
    pub(super) fn objects(&self) -> Vec<Object> {
        let mut all = catalogue(self.seed);
        match self.scenario {
            Scenario::Pads => {
                (0..self.objects).map(|i| all[i * RIGID / self.objects].clone()).collect()
            }
            Scenario::Soft => {
                let first: Vec<&str> = match &self.first[..] {
                    [] => SOFT.to_vec(),
                    first => first.iter().map(String::as_str).collect(),
                };
                let place = |o: &Object| first.iter().position(|name| *name == o.name);
                all.sort_by_key(|object| place(object).unwrap_or(first.len()));
                all.truncate(self.objects);
                all
            }
        }
    }

    /// This configuration, if a dataset can be made of it.
    pub fn validated(self) -> Result<Self> {
        let counts = [
            ("objects", self.objects, self.scenario.objects()),
            ("grasps", self.grasps, 1000),
            ("frames", self.frames, 1000),
        ];
        for (name, count, most) in counts {
            if !(1..=most).contains(&count) {
                return Err(Error::invalid(name, count, format!("1 to {most}")));
            }
        }
        let [low, high] = self.force;
        if !(low > 0.0 && high >= low && high.is_finite()) {
            let found = format!("{low} to {high} N");
            return Err(Error::invalid("force", found, "a range above 0 N"));
        }
        if !(self.depth > 0.0 && self.depth <= 0.6) {
            return Err(Error::invalid("depth", self.depth, "0 to 0.6 of the thickness"));
        }
        // Osmium is the densest; an object that is soft is solved without its weight.
        let densest = if self.scenario == Scenario::Pads { 22_600.0 } else { 0.0 };
        let settings = [
            ("shear", self.shear, 1.0),
            ("twist", self.twist, 200.0),
            ("density", self.density, densest),
        ];
        for (name, value, most) in settings {
            if !(0.0..=most).contains(&value) {
                return Err(Error::invalid(name, value, format!("0 to {most}")));
            }
        }
        let shares: f64 = self.gels.iter().map(|gel| gel.share).sum();
        if !(shares > 0.0 && self.gels.iter().all(|gel| gel.share >= 0.0)) {
            return Err(Error::invalid("gels", shares, "shares from 0 with a sum above 0"));
        }
        self.truth_element.parse::<Element>()?;
        self.know_names()?;
        Ok(self)
    }

    /// An error if a name that should come first is of no object, or of none that can be soft.
    fn know_names(&self) -> Result<()> {
        let known = match self.scenario {
            Scenario::Pads => Vec::new(),
            Scenario::Soft => catalogue(self.seed).into_iter().map(|o| o.name).collect(),
        };
        match self.first.iter().find(|name| !known.contains(name)) {
            Some(name) => Err(Error::invalid("first", name, "names of objects that are soft")),
            None => Ok(()),
        }
    }
}

/// What a gel's grasps are solved on and stored on.
pub(super) struct Pads {
    pub(super) sensor: Sensor,
    pub(super) truth: Fem,
    pub(super) model: PadMesh,
}

impl Gel {
    /// The pads with the meshes of `config`.
    pub(super) fn pads(&self, config: &Config) -> Result<Pads> {
        let sensor = Sensor::named(&self.sensor)?;
        let PadMesh { mesh, base, .. } = sensor.pad(config.truth_nodes)?;
        let truth = self.body(mesh, &base, config)?;
        Ok(Pads { truth, model: sensor.pad(config.model_nodes)?, sensor })
    }

    /// An object of this material, free.
    pub(super) fn object(&self, mesh: TetMesh, config: &Config) -> Result<Fem> {
        self.body(mesh, &[], config)
    }

    fn body(&self, mesh: TetMesh, fixed: &[u32], config: &Config) -> Result<Fem> {
        let moduli = Moduli { young: self.young, poisson: self.poisson };
        let body = SoftBody::new(mesh, Law::default(), moduli, fixed)?;
        let element = config.truth_element.parse()?;
        Fem::new(body, Options { element, friction: self.friction, ..Options::default() })
    }
}
