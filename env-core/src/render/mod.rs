//! A lit picture of rigid and soft bodies, headless, on one processor core.
//!
//! A frame is drawn in two steps. The rasteriser of `retrofire-core` (clipping and scan conversion)
//! fills a *visibility buffer*: for every sample the nearest facet and its depth. Then each pixel is
//! shaded once per facet that it sees, in linear light: a hemisphere of ambient light, a key light
//! with a shadow map, a fill light, a highlight; and contact occlusion on the ground. Averaging the
//! samples of a pixel gives the antialiasing, and the sRGB curve comes last.
//!
//! The same items give the same bytes.

mod camera;
mod gripper;
mod ground;
mod mesh;
mod raster;
mod renderer;
mod scene;
mod shade;
mod shadow;
mod touch;

pub use camera::Camera;
pub use gripper::{GripperParts, table};
pub use mesh::RenderMesh;
pub use renderer::{Item, Renderer};
pub use scene::SceneRenderer;
pub use shade::{Color, Finish};
pub use touch::{SoftView, TouchView};
