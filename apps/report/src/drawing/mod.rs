//! What commands draw: the plane from above, values over time, and the page around them.

pub mod page;
pub mod plane;
pub mod scene;
pub mod strips;
