//! Keys of a sensor's file: what each means, its unit and its range.
//!
//! From this one list a file is checked, so that all its defects are named at once, and the
//! template of a sensor of one's own is written.

use std::fmt::{self, Write as _};

use toml::{Table, Value};

/// A table of the file.
struct Section {
    /// Its name, empty for the top of the file.
    name: &'static str,
    /// Its subject, for the template.
    about: &'static str,
    /// `true` if the file must have it.
    required: bool,
    keys: &'static [Key],
}

/// A key of a table.
struct Key {
    name: &'static str,
    kind: Kind,
    /// Its meaning, for the template.
    about: &'static str,
    /// Value in the template, as TOML; optional keys without one are left out there.
    example: &'static str,
    /// `true` if the table must have it.
    required: bool,
}

/// Accepted values.
#[derive(Clone, Copy)]
enum Kind {
    Text,
    /// One of these words.
    Word(&'static [&'static str]),
    /// A number from the first to the second, with its unit.
    Number(f64, f64, &'static str),
    /// A whole number in a range.
    Count(i64, i64),
    /// Two whole numbers in a range.
    Counts(i64, i64),
    /// Lists of that many exponents.
    Exponents(usize),
    /// Lists of the numbers of red, green and blue.
    Colours,
    /// A table of these keys.
    Keys(&'static [Key]),
}

/// Names of the material laws.
pub(crate) const LAWS: [&str; 4] = ["neo-hookean", "stable-neo-hookean", "corotated", "linear"];

/// Largest Poisson's ratio: above it λ/μ exceeds 10⁶ and double precision no longer resolves the
/// shear stress.
pub(crate) const LARGEST_POISSON: f64 = 0.499_999_5;
/// Largest coefficient of friction.
pub(crate) const MOST_FRICTION: f64 = 100.0;

/// Keys of earlier files.
const UNUSED: [&str; 1] = ["friction.dynamic"];

const fn key(name: &'static str, kind: Kind, about: &'static str, example: &'static str) -> Key {
    Key { name, kind, about, example, required: true }
}

const fn optional(
    name: &'static str,
    kind: Kind,
    about: &'static str,
    example: &'static str,
) -> Key {
    Key { name, kind, about, example, required: false }
}

const SOURCE: Key = optional("source", Kind::Text, "where the numbers come from", "\"measured\"");

const FOUNDATION: [Key; 4] = [
    key("normal", Kind::Number(1e-3, 1e3, ""), "", ""),
    key("coupling", Kind::Number(0.5, 2.0, ""), "", ""),
    key("shear", Kind::Number(1e-3, 1e3, ""), "", ""),
    key("spread", Kind::Number(0.5, 2.0, ""), "", ""),
];

/// Highest power in a response of the camera.
const MOST_POWER: i64 = 12;

const IMAGE: [Key; 7] = [
    key("background_terms", Kind::Exponents(2), "at rest: exponents of x and y", "[[0, 0]]"),
    key("background", Kind::Colours, "red, green and blue of each", "[[0.5, 0.45, 0.5]]"),
    key(
        "terms",
        Kind::Exponents(4),
        "added by slopes: exponents of ∂z/∂x, ∂z/∂y, x and y",
        "[[1, 0, 0, 0], [0, 1, 0, 0]]",
    ),
    key(
        "response",
        Kind::Colours,
        "red, green and blue of each",
        "[[0.95, -0.1, -0.55], [-0.1, 0.5, 0.05]]",
    ),
    key("steepest", Kind::Number(1e-3, 10.0, ""), "slope to which the terms hold", "0.75"),
    key("smoothing", Kind::Number(0.0, 2e-3, "m"), "deviation of the blur of heights", "2.4e-4"),
    SOURCE,
];

const FILE: [Section; 7] = [
    Section {
        name: "",
        about: "",
        required: true,
        keys: &[
            key("name", Kind::Text, "name of the sensor", "\"my-sensor\""),
            optional("description", Kind::Text, "one sentence", "\"A sensor of my own\""),
        ],
    },
    Section {
        name: "outline",
        about: "Undeformed gel: a block with a curved face, bonded to a flat base.",
        required: true,
        keys: &[
            key("length", Kind::Number(1e-4, 1.0, "m"), "extent along y", "0.02525"),
            key("width", Kind::Number(1e-4, 1.0, "m"), "extent along x", "0.02075"),
            key("thickness", Kind::Number(1e-4, 1.0, "m"), "height in the middle", "0.004"),
            key(
                "radius_along",
                Kind::Number(0.0, f64::INFINITY, "m"),
                "radius of the face along y, at least half of the length; inf if straight",
                "0.210",
            ),
            key(
                "radius_across",
                Kind::Number(0.0, f64::INFINITY, "m"),
                "radius of the face along x, at least half of the width; inf if straight",
                "0.133",
            ),
            key(
                "rim_width",
                Kind::Number(0.0, 1.0, "m"),
                "width of the rounding at the sides, at most its radius; 0 if sharp",
                "0.00287",
            ),
            key(
                "rim_radius",
                Kind::Number(0.0, f64::INFINITY, "m"),
                "radius of that rounding",
                "0.00524",
            ),
        ],
    },
    Section {
        name: "gel",
        about: "",
        required: true,
        keys: &[key("density", Kind::Number(0.0, 3e4, "kg/m³"), "density", "1000.0"), SOURCE],
    },
    Section {
        name: "calibration",
        about: "Material of the gel; several may follow each other, the first is the default.",
        required: true,
        keys: &[
            key("name", Kind::Text, "name, for the setting material", "\"measured\""),
            key("young", Kind::Number(1.0, 1e12, "Pa"), "Young's modulus", "0.30e6"),
            key("poisson", Kind::Number(0.0, LARGEST_POISSON, ""), "Poisson's ratio", "0.47"),
            key("law", Kind::Word(&LAWS), "material law", "\"neo-hookean\""),
            SOURCE,
            optional(
                "elastic_foundation",
                Kind::Keys(&FOUNDATION),
                "springs that stand for the gel in the rigid-body engine",
                "",
            ),
        ],
    },
    Section {
        name: "friction",
        about: "Coulomb friction of the gel.",
        required: true,
        keys: &[
            key(
                "static",
                Kind::Number(0.0, MOST_FRICTION, ""),
                "coefficient, while sliding too",
                "1.0",
            ),
            SOURCE,
        ],
    },
    Section {
        name: "markers",
        about: "Printed markers, a centred grid; leave the table out if there are none.",
        required: false,
        keys: &[
            key("across", Kind::Count(1, 1000), "markers in a row along x", "7"),
            key("along", Kind::Count(1, 1000), "markers in a row along y", "9"),
            key("pitch", Kind::Number(1e-5, 1.0, "m"), "distance of neighbours", "2.06e-3"),
            SOURCE,
        ],
    },
    Section {
        name: "camera",
        about: "Camera behind the gel, its picture centred on the middle of the face.",
        required: true,
        keys: &[
            key("pixels", Kind::Counts(1, 10_000), "pixels along x and along y", "[240, 320]"),
            key("pixel", Kind::Number(1e-7, 1.0, "m"), "size of a pixel on the face", "6.34e-5"),
            SOURCE,
            optional("image", Kind::Keys(&IMAGE), "colours of the tactile image", ""),
        ],
    },
];

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Text => f.write_str("a text"),
            Self::Word(words) => write!(f, "one of {}", words.join(", ")),
            Self::Number(low, high, unit) => write!(f, "{low} to {high} {unit}"),
            Self::Count(low, high) => write!(f, "a whole number from {low} to {high}"),
            Self::Counts(low, high) => write!(f, "two whole numbers from {low} to {high}"),
            Self::Exponents(count) => {
                write!(f, "lists of {count} whole numbers from 0 to {MOST_POWER}")
            }
            Self::Colours => f.write_str("lists of 3 numbers"),
            Self::Keys(keys) => write!(f, "{{ {} }}", names(keys)),
        }
    }
}

impl Kind {
    /// Returns whether `value` is accepted.
    fn takes(&self, value: &Value) -> bool {
        let whole = |value: &Value, low, high| {
            value.as_integer().is_some_and(|count| (low..=high).contains(&count))
        };
        match *self {
            Self::Text => value.is_str(),
            Self::Word(words) => value.as_str().is_some_and(|word| words.contains(&word)),
            Self::Number(low, high, _) => {
                let number = value.as_float().or(value.as_integer().map(|count| count as f64));
                number.is_some_and(|number| (low..=high).contains(&number))
            }
            Self::Count(low, high) => whole(value, low, high),
            Self::Counts(low, high) => value
                .as_array()
                .is_some_and(|two| two.len() == 2 && two.iter().all(|one| whole(one, low, high))),
            Self::Exponents(count) => lists(value, count, &|power| whole(power, 0, MOST_POWER)),
            Self::Colours => lists(value, 3, &|number| {
                number.is_integer() || number.as_float().is_some_and(f64::is_finite)
            }),
            Self::Keys(_) => value.is_table(),
        }
    }
}

/// Returns whether `value` is a list of lists of `count` values that `takes` accepts.
fn lists(value: &Value, count: usize, takes: &dyn Fn(&Value) -> bool) -> bool {
    value.as_array().is_some_and(|rows| {
        let row = |row: &Value| {
            row.as_array().is_some_and(|row| row.len() == count && row.iter().all(takes))
        };
        rows.iter().all(row)
    })
}

fn names(keys: &[Key]) -> String {
    keys.iter().map(|key| key.name).collect::<Vec<_>>().join(", ")
}

/// Returns every defect of a file's `text`: missing and unknown keys, and values of the wrong type
/// or out of range.
pub(super) fn check(text: &str) -> Result<(), Vec<String>> {
    let file: Table = text.parse().map_err(|error: toml::de::Error| vec![error.to_string()])?;
    let mut defects = Vec::new();
    let top = FILE[0].keys;
    let known: Vec<_> =
        top.iter().map(|key| key.name).chain(FILE[1..].iter().map(|s| s.name)).collect();
    unknown(&file, "", &known, &mut defects);
    keys(&file, "", top, &mut defects);
    for section in &FILE[1..] {
        let name = section.name;
        match file.get(name) {
            None if section.required => defects.push(format!("{name}: missing, expected a table")),
            None => {}
            Some(Value::Table(table)) if name != "calibration" => {
                whole_table(table, name, section.keys, &mut defects);
            }
            Some(Value::Array(tables))
                if name == "calibration"
                    && !tables.is_empty()
                    && tables.iter().all(Value::is_table) =>
            {
                for (i, table) in tables.iter().filter_map(Value::as_table).enumerate() {
                    let place =
                        if tables.len() == 1 { name.to_owned() } else { format!("{name}[{i}]") };
                    whole_table(table, &place, section.keys, &mut defects);
                }
            }
            Some(other) => {
                let expected = if name == "calibration" { "[[calibration]]" } else { "a table" };
                defects.push(format!("{name}: found {other}, expected {expected}"));
            }
        }
    }
    if defects.is_empty() { Ok(()) } else { Err(defects) }
}

/// Adds the defects of a table with these keys.
fn whole_table(table: &Table, place: &str, expected: &[Key], defects: &mut Vec<String>) {
    let known: Vec<_> = expected.iter().map(|key| key.name).collect();
    unknown(table, place, &known, defects);
    keys(table, place, expected, defects);
}

/// Adds the missing keys of a table and those with a wrong value.
fn keys(table: &Table, place: &str, expected: &[Key], defects: &mut Vec<String>) {
    for key in expected {
        let name = path(place, key.name);
        match table.get(key.name) {
            None if key.required => {
                let about = if key.about.is_empty() { "" } else { ": " };
                let (kind, text) = (key.kind, key.about);
                let expected = kind.to_string();
                defects.push(format!("{name}: missing, expected {}{about}{text}", expected.trim()));
            }
            None => {}
            Some(value) if !key.kind.takes(value) => {
                let expected = key.kind.to_string();
                defects.push(format!("{name}: found {value}, expected {}", expected.trim()));
            }
            Some(value) => {
                if let (Kind::Keys(inner), Some(table)) = (key.kind, value.as_table()) {
                    whole_table(table, &name, inner, defects);
                }
            }
        }
    }
}

/// Adds the keys of a table that are none of `known`.
fn unknown(table: &Table, place: &str, known: &[&str], defects: &mut Vec<String>) {
    for found in table.keys().filter(|key| !known.contains(&key.as_str())) {
        let name = path(place, found);
        if UNUSED.contains(&name.as_str()) {
            defects.push(format!("{name}: no longer used, expected the line to be removed"));
            continue;
        }
        let near = known
            .iter()
            .map(|name| (strsim::jaro_winkler(found, name), *name))
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .filter(|(likeness, _)| *likeness > 0.8);
        let hint = match near {
            Some((_, name)) => format!("did you mean {name}?"),
            None => format!("expected {}", known.join(", ")),
        };
        defects.push(format!("{name}: unknown, {hint}"));
    }
}

fn path(place: &str, name: &str) -> String {
    if place.is_empty() { name.to_owned() } else { format!("{place}.{name}") }
}

/// A sensor's file with every key explained, which can be used as it is.
pub fn template() -> String {
    let mut text = String::from(
        "# A tactile sensor. Across is x, along is y, z leaves the gel; the numbers are those of a\n\
         # GelSight Mini. `ruffini sensor check FILE` says what is wrong with a file.\n",
    );
    let mut line = |line: String| writeln!(text, "{line}").expect("a string takes all");
    for Section { name, about, keys, .. } in &FILE {
        match *name {
            "" => {}
            name => {
                line(String::new());
                if !about.is_empty() {
                    line(format!("# {about}"));
                }
                let repeated = name == "calibration";
                line(if repeated { format!("[[{name}]]") } else { format!("[{name}]") });
            }
        }
        for key in keys.iter().filter(|key| !key.example.is_empty()) {
            line(explained(key));
        }
        if *name == "calibration" {
            line(
                "# elastic_foundation, four numbers of the springs that stand for the gel in the\n\
                  # rigid-body engine: `ruffini sensor check FILE --fit` finds them. Without them\n\
                  # those of the GelSight Mini are used."
                    .to_owned(),
            );
        }
        if *name == "camera" {
            line(
                "\n# Colours of the channel `image`, from 0 to 1: sums of products of powers, x and y in\n\
                 # halves of the view's longer edge. Without this table there is no such channel.\n\
                 # [camera.image]"
                    .to_owned(),
            );
            for key in &IMAGE {
                line(format!("# {}", explained(key)));
            }
        }
    }
    text
}

/// Line of the template that gives a key its example.
fn explained(key: &Key) -> String {
    let range = match key.kind {
        Kind::Text => String::new(),
        kind => format!(": {}", kind.to_string().trim()),
    };
    format!("{:<30} # {}{range}", format!("{} = {}", key.name, key.example), key.about)
}

#[cfg(test)]
mod tests {
    use super::{super::Sensor, *};

    #[test]
    fn the_template_is_a_sensor() {
        let sensor = Sensor::parse("my.toml", &template()).unwrap();
        let mini = Sensor::named("gelsight-mini").unwrap();
        assert_eq!((sensor.outline, sensor.camera.pixels), (mini.outline, mini.camera.pixels));
        assert_eq!(sensor.calibrations[0].elastic_foundation, None);
    }

    #[test]
    fn the_templates_table_of_an_image_can_be_used_as_it_is() {
        let text = template();
        let (before, image) = text.split_once("# [camera.image]\n").unwrap();
        assert_eq!(Sensor::parse("my.toml", before).unwrap().camera.image, None);
        let image: Vec<_> = image.lines().map(|line| line.strip_prefix("# ").unwrap()).collect();
        let text = format!("{before}[camera.image]\n{}\n", image.join("\n"));
        let response = Sensor::parse("my.toml", &text).unwrap().camera.image.unwrap();
        assert_eq!((response.background.len(), response.response.len()), (1, 2));
        assert!((response.smoothing - 2.4e-4).abs() < f64::EPSILON, "{}", response.smoothing);
    }

    #[test]
    fn all_defects_are_named_at_once() {
        let text = template()
            .replace("thickness =", "thicknes =")
            .replace("poisson = 0.47", "poisson = 0.6")
            .replace("density = 1000.0", "density = \"heavy\"")
            .replace("pixels = [240, 320]", "pixels = [240]")
            .replace("[friction]", "[friction]\ndynamic = 1.0");
        let message = Sensor::parse("my.toml", &text).unwrap_err().to_string();
        let expected = [
            "outline.thicknes: unknown, did you mean thickness?",
            "outline.thickness: missing, expected 0.0001 to 1 m: height in the middle",
            "calibration.poisson: found 0.6, expected 0 to 0.4999995",
            "gel.density: found \"heavy\", expected 0 to 30000 kg/m³",
            "camera.pixels: found [240], expected two whole numbers from 1 to 10000",
            "friction.dynamic: no longer used, expected the line to be removed",
        ];
        for part in expected {
            assert!(message.contains(part), "{part} is not in: {message}");
        }
        assert_eq!(message.matches("; ").count() + 1, expected.len(), "{message}");
    }
}
