//! Software rendering of rigid and soft bodies, without a display, on one processor core.
//!
//! A frame is drawn in two steps. The rasteriser of `retrofire-core` (clipping and scan conversion)
//! fills a *visibility buffer*: for every sample the nearest facet and its depth. Then each pixel
//! is shaded once per facet visible in it, in linear light: a hemisphere of ambient light, a key
//! light with a shadow map, a fill light, a highlight, and contact occlusion on the ground. The
//! samples of a pixel are averaged for antialiasing, and the sRGB curve is applied last.
//!
//! Equal items give equal bytes.

mod camera;
mod font;
mod gripper;
mod ground;
mod mesh;
mod raster;
mod renderer;
mod scene;
mod shade;
mod shadow;
mod touch;

pub use camera::{PinholeCamera, Viewpoint};
pub use gripper::{GripperParts, table};
pub use mesh::RenderMesh;
pub use renderer::{Item, Renderer};
pub use scene::SceneRenderer;
pub use shade::{Color, Finish};
pub use touch::{DeformationView, DeformedBodies, STRESS_COLORS};
