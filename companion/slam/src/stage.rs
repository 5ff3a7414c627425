//! The stages of a frame's way through the SLAM, for those who take the time of each.

/// What is done with a frame, in this order; a stage that a frame does not need is left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Corners, their descriptions and depth are found: [`FrontEnd::look`](crate::FrontEnd::look).
    Features,
    /// Points of the map are found among them and the pose is fitted.
    Pose,
    /// What moves is found, and the pose fitted again without it.
    Moving,
    /// The frame becomes a keyframe: points are added, the window of keyframes is adjusted, the map is tidied.
    Keyframe,
}

impl Stage {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Features, Self::Pose, Self::Moving, Self::Keyframe];
}

/// Is told whenever a stage is over.
pub(crate) type Watch = Box<dyn FnMut(Stage) + Send>;
