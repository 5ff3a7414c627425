//! The layers of the map, each of which can be hidden.

/// One layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Layer {
    /// The voxels.
    Map,
    /// The ground grid.
    Grid,
    /// Where the ground vehicle can drive.
    Traversability,
    /// Where the vehicles were.
    Tracks,
    /// Where they shall go.
    Plans,
    /// Where the map is seen from.
    Camera,
    /// The axes of the map's frame.
    Axes,
}

impl Layer {
    /// All, in the order of the menu.
    pub const ALL: [Self; 7] = [
        Self::Map,
        Self::Grid,
        Self::Traversability,
        Self::Tracks,
        Self::Plans,
        Self::Camera,
        Self::Axes,
    ];

    /// Its name in scripts.
    pub fn word(self) -> &'static str {
        match self {
            Self::Map => "map",
            Self::Grid => "grid",
            Self::Traversability => "traversability",
            Self::Tracks => "tracks",
            Self::Plans => "plans",
            Self::Camera => "camera",
            Self::Axes => "axes",
        }
    }

    /// Its name on the screen.
    pub fn label(self) -> &'static str {
        match self {
            Self::Map => "Map",
            Self::Grid => "Grid",
            Self::Traversability => "Drivable",
            Self::Tracks => "Tracks",
            Self::Plans => "Plans",
            Self::Camera => "Camera",
            Self::Axes => "Axes",
        }
    }
}

/// Which layers are shown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layers {
    hidden: Vec<Layer>,
}

impl Default for Layers {
    /// All but the traversability overlay, which covers the map.
    fn default() -> Self {
        Self {
            hidden: vec![Layer::Traversability],
        }
    }
}

impl Layers {
    /// Whether it is shown.
    pub fn shows(&self, layer: Layer) -> bool {
        !self.hidden.contains(&layer)
    }

    /// Shows it.
    pub fn show(&mut self, layer: Layer) {
        self.hidden.retain(|hidden| *hidden != layer);
    }

    /// Hides it.
    pub fn hide(&mut self, layer: Layer) {
        self.show(layer);
        self.hidden.push(layer);
    }

    /// Shows it if it is hidden, and hides it if it is shown.
    pub fn toggle(&mut self, layer: Layer) {
        if self.shows(layer) {
            self.hide(layer);
        } else {
            self.show(layer);
        }
    }
}
