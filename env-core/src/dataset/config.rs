//! Configuration of a dataset.

use std::{ffi::OsStr, fs, path::Path};

use serde::{Deserialize, Serialize};

use super::{
    indentation,
    mesh_object::{self, MeshObject},
};
use crate::{
    Error, Result,
    contact::check_friction,
    deformation::{Law, Moduli, SoftBody},
    error::within,
    fem::{Element, Fem, FemOptions},
    geometry::{PadMesh, TetMesh},
    objects::{Object, catalogue, indenters, names},
    sensor::{MOST_FRICTION, Sensor},
};

/// Settings that determine the bytes of a dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DatasetConfig {
    /// Seed of objects, grasps and perturbations.
    pub seed: u64,
    /// Soft side of the grasps.
    pub scenario: Scenario,
    /// Number of drawn objects, 0 only where there are `meshes`. For soft pads, they are taken
    /// evenly from the 63 rigid ones of the catalogue; for soft objects, from all 64, those in
    /// `first` before the others. Indenters are drawn one by one.
    pub objects: usize,
    /// Meshes of one's own, each an object after the drawn ones.
    #[serde(rename = "object", skip_serializing_if = "Vec::is_empty")]
    pub meshes: Vec<MeshObject>,
    /// Number of indenters, the last ones, that touch at many small places.
    #[serde(skip_serializing_if = "is_none")]
    pub textured: usize,
    /// Names of the soft objects that come first; if empty, those of [`SOFT`].
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub first: Vec<String>,
    /// Number of grasps of each object.
    pub grasps: usize,
    /// Number of frames of growing force in each grasp. Presses of indenters have up to
    /// seven, for which the default stands, too.
    pub frames: usize,
    /// Number of nodes of the mesh on which fields are stored.
    pub model_nodes: usize,
    /// Number of nodes of the mesh on which grasps are solved.
    pub truth_nodes: usize,
    /// Name of the element used to solve them.
    pub truth_element: String,
    /// Greatest number of node spacings across the part of the face that an indenter covers; fewer
    /// where there are not enough nodes.
    #[serde(skip_serializing_if = "is_rough")]
    pub truth_across: f64,
    /// Number of equal load steps, by finite elements and by linear elasticity, from one frame of
    /// an indenter to the next.
    #[serde(skip_serializing_if = "is_one")]
    pub truth_steps: usize,
    /// Number of nodes of the mesh of linear elasticity with finely resolved contact, to which
    /// presses add what the nonlinear law changes on the truth mesh; 0 stores the solution on the
    /// truth mesh as it is.
    #[serde(skip_serializing_if = "is_none")]
    pub truth_linear_nodes: usize,
    /// Smallest and greatest force at which a grasp ends (N).
    pub force: [f64; 2],
    /// Closing at which a grasp ends, whatever its force: of each pad, over its thickness, or of
    /// each finger, over half the object's width there.
    pub depth: f64,
    /// Greatest shift of the pads relative to each other along their faces, over their closing.
    pub shear: f64,
    /// Greatest rotation of the pads relative to each other about their normals, over their closing
    /// (rad/m).
    pub twist: f64,
    /// Least and greatest factor by which solids of hand size are scaled to indenters.
    #[serde(skip_serializing_if = "is_usual")]
    pub scale: [f64; 2],
    /// Density of rigid objects (kg/m³), whose weight acts along the fingers, away from the wrist;
    /// 0 omits the weight.
    #[serde(skip_serializing_if = "is_zero")]
    pub density: f64,
    /// Materials of the soft side, each with its pads or fingers, drawn for each grasp by their
    /// shares.
    pub gels: Vec<GelConfig>,
}

/// Soft side of a grasp.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scenario {
    /// Two soft pads on a rigid object that comes to equilibrium between them.
    #[default]
    Pads,
    /// A soft object between two rigid fingers with the pads' outlines.
    Soft,
    /// One soft pad under an indenter of any size that moves through given poses.
    Presses,
}

/// Soft objects that come first: solids of six kinds, the strawberry among them. The paper's
/// ablation has six objects and does not name the others.
pub const SOFT: [&str; 6] =
    ["strawberry-1", "lemon-1", "eggplant-1", "sphere-1", "cylinder-1", "cuboid-1"];

/// Soft material, with its friction and the sensor whose pads are used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GelConfig {
    /// Name of the sensor whose pads are used, or whose pad outline the fingers have, or the path
    /// of its .toml file. In a TOML file, the path is relative to the folder of that file; in a
    /// finished dataset, it is the file's name.
    pub sensor: String,
    /// Content of the sensor's file, if it is one; if missing, it is filled in by
    /// [`DatasetConfig::validated`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub definition: Option<String>,
    /// Young's modulus at small strain (Pa).
    pub young: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Coefficient of friction between soft and rigid side.
    pub friction: f64,
    /// Frequency with which it is drawn, relative to the others.
    pub share: f64,
}

impl Default for DatasetConfig {
    /// The paper's 63 objects × 100 grasps × 50 frames. Three of four grasps use the two published
    /// calibrations of the `GelSight` Mini, the others softer and stiffer gels and a second sensor.
    /// 80 N is the force of a strong gripper of this size; below 20 N, one grasp in twenty-five
    /// compresses the gel by more than a third.
    fn default() -> Self {
        let gel = |sensor: &str, young, poisson, friction, share| GelConfig {
            sensor: sensor.to_owned(),
            definition: None,
            young,
            poisson,
            friction,
            share,
        };
        Self {
            seed: 0,
            scenario: Scenario::Pads,
            objects: 63,
            meshes: Vec::new(),
            textured: 0,
            first: Vec::new(),
            grasps: 100,
            frames: USUAL_FRAMES,
            model_nodes: 1000,
            truth_nodes: 2000,
            truth_element: "p1-bar".to_owned(),
            truth_across: ACROSS,
            truth_steps: 1,
            truth_linear_nodes: 0,
            force: [2.0, 80.0],
            depth: 0.5,
            shear: 0.4,
            twist: 60.0,
            scale: SCALE,
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

#[allow(clippy::trivially_copy_pass_by_ref)] // Signature required by serde.
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

#[allow(clippy::trivially_copy_pass_by_ref)] // Signature required by serde.
fn is_none(count: &usize) -> bool {
    *count == 0
}

#[allow(clippy::trivially_copy_pass_by_ref)] // Signature required by serde.
fn is_one(count: &usize) -> bool {
    *count == 1
}

/// Frames of a grasp if not configured.
const USUAL_FRAMES: usize = 50;

/// Usual distances between nodes across an indenter.
const ACROSS: f64 = 8.0;

#[allow(clippy::trivially_copy_pass_by_ref)] // Signature required by serde.
fn is_rough(across: &f64) -> bool {
    *across == ACROSS
}

/// Usual factors of scale of indenters: features of 0.3 to 40 mm.
const SCALE: [f64; 2] = [0.02, 1.2];

fn is_usual(scale: &[f64; 2]) -> bool {
    *scale == SCALE
}

/// Number of rigid objects in the catalogue.
const RIGID: usize = 63;
/// Most grasps of an object.
const MOST_GRASPS: usize = 1000;
/// Most indenters.
const INDENTERS: usize = 100_000;

impl Scenario {
    fn objects(self) -> usize {
        match self {
            Self::Pads => RIGID,
            Self::Soft => RIGID + 1,
            Self::Presses => INDENTERS,
        }
    }
}

impl DatasetConfig {
    /// Reads the configuration from a TOML file; missing settings take their defaults.
    pub fn read(path: &Path) -> Result<Self> {
        let text = fs::read_to_string(path).map_err(|error| Error::file(path, error))?;
        let config: Self = toml::from_str(&text).map_err(|error| Error::file(path, error))?;
        config.with_files_in(path.parent().unwrap_or(Path::new(""))).validated()
    }

    /// Returns this configuration with the paths of its meshes and sensors relative to `folder`.
    pub(super) fn with_files_in(mut self, folder: &Path) -> Self {
        self.meshes.iter_mut().for_each(|mesh| *mesh = mesh.within(folder));
        for gel in self.gels.iter_mut().filter(|gel| Sensor::is_file(&gel.sensor)) {
            gel.sensor = folder.join(&gel.sensor).display().to_string();
        }
        self
    }

    /// Returns this configuration as it is stored in a dataset, which has copies of the meshes and
    /// the contents of sensors' files.
    pub(super) fn stored(&self) -> Self {
        let meshes = self.meshes.iter().map(MeshObject::stored).collect();
        let gels = self.gels.iter().map(GelConfig::stored).collect();
        Self { meshes, gels, ..self.clone() }
    }

    /// Objects of the dataset, in order.
    pub(super) fn objects(&self) -> Result<Vec<Object>> {
        Ok([self.drawn(), self.own_objects()?].concat())
    }

    /// Reads the objects from mesh files. Returns an error if a file is missing or changed, or
    /// holds no solid of hand scale around its origin.
    pub fn own_objects(&self) -> Result<Vec<Object>> {
        self.meshes.iter().map(|mesh| mesh.object(self.seed)).collect()
    }

    /// Number of grasps asked for of an object.
    pub(super) fn grasps_of(&self, object: &Object) -> usize {
        let own = self.meshes.iter().find(|mesh| mesh.name() == object.name);
        own.and_then(|mesh| mesh.grasps).unwrap_or(self.grasps)
    }

    /// Objects that are drawn from families, in order.
    pub(super) fn drawn(&self) -> Vec<Object> {
        if self.scenario == Scenario::Presses {
            return indenters(self.seed, self.objects, self.textured, self.scale);
        }
        let mut all = catalogue(self.seed);
        match self.scenario {
            Scenario::Pads | Scenario::Presses => {
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

    /// Most frames of a grasp or press.
    pub(super) fn most_frames(&self) -> usize {
        match self.scenario {
            Scenario::Pads | Scenario::Soft => self.frames,
            Scenario::Presses => indentation::FRAMES,
        }
    }

    /// Least and greatest coefficient of friction, if they are drawn for each press.
    pub fn frictions(&self) -> Option<[f64; 2]> {
        (self.scenario == Scenario::Presses).then_some(indentation::FRICTION)
    }

    /// Returns this configuration with the hashes of its meshes, or an error if no dataset can be
    /// made from it.
    pub fn validated(mut self) -> Result<Self> {
        let fewest = usize::from(self.meshes.is_empty());
        let mut counts = vec![
            ("objects", self.objects, fewest, self.scenario.objects()),
            ("grasps", self.grasps, 1, MOST_GRASPS),
            ("frames", self.frames, 1, 1000),
            ("truth_steps", self.truth_steps, 1, 100),
        ];
        if self.truth_linear_nodes > 0 {
            counts.push(("truth_linear_nodes", self.truth_linear_nodes, 100, 100_000));
        }
        let own = self.meshes.iter().filter_map(|mesh| mesh.grasps);
        counts.extend(own.map(|count| ("object.grasps", count, 1, MOST_GRASPS)));
        for (name, count, least, most) in counts {
            within(name, count, [least, most])?;
        }
        let presses = self.scenario == Scenario::Presses;
        if presses && ![indentation::FRAMES, USUAL_FRAMES].contains(&self.frames) {
            let expected = format!("{}, as many as a press has", indentation::FRAMES);
            return Err(Error::invalid("frames", self.frames, expected));
        }
        let quadratic = self.truth_element.parse::<Element>()? == Element::P2;
        if self.truth_linear_nodes > 0 && !(presses && quadratic) {
            let expected = "0, unless of presses solved by the element p2";
            return Err(Error::invalid("truth_linear_nodes", self.truth_linear_nodes, expected));
        }
        let most = if presses { self.objects } else { 0 };
        if self.textured > most {
            let expected = format!("0 to {most}, the number of indenters");
            return Err(Error::invalid("textured", self.textured, expected));
        }
        let [low, high] = self.force;
        if !(low > 0.0 && high >= low && high.is_finite()) {
            let found = format!("{low} to {high} N");
            return Err(Error::invalid("force", found, "a range above 0 N"));
        }
        if !(self.depth > 0.0 && self.depth <= 0.6) {
            return Err(Error::invalid("depth", self.depth, "0 to 0.6 of the thickness"));
        }
        let [least, most] = self.scale;
        if !(least >= 0.01 && most >= least && most <= 2.0) {
            let found = format!("{least} to {most}");
            return Err(Error::invalid("scale", found, "a range from 0.01 to 2"));
        }
        within("truth_across", self.truth_across, [1.0, 100.0])?;
        // Osmium is the densest element; soft objects are solved without their weight.
        let densest = if self.scenario == Scenario::Pads { 22_600.0 } else { 0.0 };
        let settings = [
            ("shear", self.shear, 1.0),
            ("twist", self.twist, 200.0),
            ("density", self.density, densest),
        ];
        for (name, value, most) in settings {
            within(name, value, [0.0, most])?;
        }
        let shares: f64 = self.gels.iter().map(|gel| gel.share).sum();
        if !(shares > 0.0 && self.gels.iter().all(|gel| gel.share >= 0.0)) {
            return Err(Error::invalid("gels", shares, "shares from 0 with a sum above 0"));
        }
        let defined = |(i, gel): (usize, GelConfig)| {
            gel.defined().map_err(|error| error.within(&format!("gels[{i}]")))
        };
        self.gels = self.gels.into_iter().enumerate().map(defined).collect::<Result<_>>()?;
        self.know_names()?;
        self.meshes = mesh_object::identified(self.meshes)?;
        self.own_objects()?;
        Ok(self)
    }

    /// Returns an error if a name in `first` is not that of an object, or if the scenario has no
    /// soft objects.
    fn know_names(&self) -> Result<()> {
        let known: Vec<_> = match self.scenario {
            Scenario::Pads | Scenario::Presses => Vec::new(),
            Scenario::Soft => names().collect(),
        };
        let Some(name) = self.first.iter().find(|name| !known.contains(name)) else {
            return Ok(());
        };
        let expected = match &known[..] {
            [] => "no names, which are for the scenario soft".to_owned(),
            known => format!("one of {}", known.join(", ")),
        };
        Err(Error::invalid("first", name, expected))
    }
}

/// Sensor, finite-element model and storage mesh of the pads of one gel.
pub(super) struct PadModels {
    pub(super) sensor: Sensor,
    pub(super) truth: Fem,
    pub(super) model: PadMesh,
}

impl GelConfig {
    /// Returns this gel with the content of its sensor's file; an error if there is no such sensor,
    /// or if no material can have these moduli or this friction.
    fn defined(mut self) -> Result<Self> {
        self.moduli().check()?;
        check_friction(self.friction, MOST_FRICTION)?;
        if self.definition.is_none() && Sensor::is_file(&self.sensor) {
            let text = fs::read_to_string(&self.sensor);
            self.definition = Some(text.map_err(|error| Error::file(&self.sensor, error))?);
        }
        self.sensor().map(|_| self)
    }

    /// Returns this gel with the name of its sensor's file as its path.
    fn stored(&self) -> Self {
        let name = match self.definition {
            Some(_) => Path::new(&self.sensor).file_name().and_then(OsStr::to_str),
            None => None,
        };
        Self { sensor: name.unwrap_or(&self.sensor).to_owned(), ..self.clone() }
    }

    /// The sensor.
    pub(crate) fn sensor(&self) -> Result<Sensor> {
        match &self.definition {
            Some(text) => Sensor::parse(&self.sensor, text),
            None => Sensor::named(&self.sensor),
        }
    }

    /// Builds the pads with the meshes of `config`.
    pub(super) fn pads(&self, config: &DatasetConfig) -> Result<PadModels> {
        let sensor = self.sensor()?;
        let PadMesh { mesh, base, .. } = sensor.pad(config.truth_nodes)?;
        let truth = self.body((mesh, Law::default()), &base, config, FemOptions::default())?;
        Ok(PadModels { truth, model: sensor.pad(config.model_nodes)?, sensor })
    }

    /// Builds a free object of this material.
    pub(super) fn object(&self, mesh: TetMesh, config: &DatasetConfig) -> Result<Fem> {
        self.body((mesh, Law::default()), &[], config, FemOptions::default())
    }

    /// Elastic moduli.
    pub(crate) fn moduli(&self) -> Moduli {
        Moduli { young: self.young, poisson: self.poisson }
    }

    /// Builds finite elements of this material on a mesh with `fixed` nodes.
    pub(super) fn body(
        &self,
        (mesh, law): (TetMesh, Law),
        fixed: &[u32],
        config: &DatasetConfig,
        limits: FemOptions,
    ) -> Result<Fem> {
        let body = SoftBody::new(mesh, law, self.moduli(), fixed)?;
        let element = config.truth_element.parse()?;
        let friction = self.friction;
        Fem::new(body, FemOptions { element, friction, ..limits })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;

    #[test]
    fn textured_indenters_come_after_those_that_are_drawn_without_them() {
        let drawn = |objects, textured| {
            DatasetConfig {
                scenario: Scenario::Presses,
                objects,
                textured,
                ..DatasetConfig::default()
            }
            .drawn()
        };
        let (all, plain) = (drawn(600, 200), drawn(400, 0));
        assert_eq!((all.len(), &all[..400]), (600, &plain[..]));
        assert!(all[400..].iter().all(|object| matches!(object.shape, Shape::Mesh(_))));
    }

    #[test]
    fn presses_have_their_own_number_of_frames() {
        let of = |scenario, frames| {
            DatasetConfig { scenario, frames, ..DatasetConfig::default() }.validated()
        };
        let error = of(Scenario::Presses, 2).unwrap_err().to_string();
        assert_eq!(error, "frames: found 2, expected 7, as many as a press has");
        for frames in [7, DatasetConfig::default().frames] {
            assert_eq!(of(Scenario::Presses, frames).unwrap().most_frames(), 7);
        }
        assert_eq!(of(Scenario::Pads, 2).unwrap().most_frames(), 2);
    }

    #[test]
    fn only_indenters_can_be_textured() {
        let refused = |scenario, textured| {
            let config =
                DatasetConfig { scenario, objects: 60, textured, ..DatasetConfig::default() };
            config.validated().is_err_and(|error| error.to_string().starts_with("textured"))
        };
        assert!(refused(Scenario::Pads, 1) && refused(Scenario::Presses, 61));
        assert!(!refused(Scenario::Pads, 0) && !refused(Scenario::Presses, 60));
    }
}
