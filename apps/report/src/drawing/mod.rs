//! What commands draw: the plane from above, values over time, and the page around them.

pub(crate) mod page;
pub(crate) mod plane;
pub(crate) mod scene;
pub(crate) mod strips;
