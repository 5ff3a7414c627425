//! What kinds of things there are.

/// What a surface belongs to, after the classes of Cityscapes; the numbers go into mask pictures and voxel truth.
///
/// - M. Cordts et al., *The Cityscapes Dataset for Semantic Urban Scene Understanding*, CVPR 2016, table 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Class {
    /// Nothing: the sky.
    Sky = 0,
    /// Where vehicles drive, with its markings.
    Road = 1,
    /// Where people walk, with its kerb.
    Sidewalk = 2,
    /// Grass, soil, yards.
    Terrain = 3,
    /// Houses and halls, with what is fixed to them.
    Building = 4,
    /// Walls and fences that stand alone.
    Wall = 5,
    /// Poles of lamps and signs.
    Pole = 6,
    /// Traffic signs.
    Sign = 7,
    /// Trees and hedges.
    Vegetation = 8,
    /// Bridges and roofs over a road, with their pillars.
    Bridge = 9,
    /// Bins, benches, boxes, containers: what stands about and belongs to nobody's class.
    Object = 10,
    /// Cars, parked or not.
    Car = 11,
    /// Trucks and vans.
    Truck = 12,
    /// Buses.
    Bus = 13,
    /// People on bicycles, with the bicycle.
    Cyclist = 14,
    /// People on foot.
    Pedestrian = 15,
    /// The ground vehicle of ours.
    Robot = 16,
}

impl Class {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 17] = [
        Self::Sky,
        Self::Road,
        Self::Sidewalk,
        Self::Terrain,
        Self::Building,
        Self::Wall,
        Self::Pole,
        Self::Sign,
        Self::Vegetation,
        Self::Bridge,
        Self::Object,
        Self::Car,
        Self::Truck,
        Self::Bus,
        Self::Cyclist,
        Self::Pedestrian,
        Self::Robot,
    ];

    /// Whether it is something that may move, for which there are boxes.
    pub fn is_traffic(self) -> bool {
        self >= Self::Car
    }

    /// Its colour in pictures of masks: that of Cityscapes where it has one.
    pub fn colour(self) -> [u8; 3] {
        match self {
            Self::Sky => [70, 130, 180],
            Self::Road => [128, 64, 128],
            Self::Sidewalk => [244, 35, 232],
            Self::Terrain => [152, 251, 152],
            Self::Building => [70, 70, 70],
            Self::Wall => [102, 102, 156],
            Self::Pole => [153, 153, 153],
            Self::Sign => [220, 220, 0],
            Self::Vegetation => [107, 142, 35],
            Self::Bridge => [150, 100, 100],
            Self::Object => [230, 150, 140],
            Self::Car => [0, 0, 142],
            Self::Truck => [0, 0, 70],
            Self::Bus => [0, 60, 100],
            Self::Cyclist => [255, 0, 0],
            Self::Pedestrian => [220, 20, 60],
            Self::Robot => [255, 255, 255],
        }
    }
}
