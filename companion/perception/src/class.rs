//! The 80 classes of COCO, and whether what belongs to them moves.
//!
//! - T.-Y. Lin et al., *Microsoft COCO: Common Objects in Context*, ECCV 2014; the order is that of `COCO`'s detection
//!   challenge, without the eleven classes that it left out.

use std::fmt;

use maps::evidence::Mobility;

/// What an object is, as COCO numbers it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Class(u8);

impl Class {
    /// How many classes there are.
    pub const COUNT: usize = NAMES.len();

    /// The class of an index into a network's scores; `None` from 80 on.
    pub fn from_index(index: usize) -> Option<Self> {
        let index = u8::try_from(index).ok()?;
        (usize::from(index) < Self::COUNT).then_some(Self(index))
    }

    /// The class of this name, as [`Class::name`] gives it.
    pub fn named(name: &str) -> Option<Self> {
        NAMES
            .iter()
            .position(|&known| known == name)
            .and_then(Self::from_index)
    }

    /// Its English name, lower case.
    pub fn name(self) -> &'static str {
        NAMES[usize::from(self.0)]
    }

    /// Whether it moves by itself (people, animals), may move (vehicles, and what people carry, throw and push), or is
    /// static (furniture, what stands at the roadside).
    ///
    /// A car may be parked, and most are: by its class alone it is [`Mobility::Movable`].
    pub fn mobility(self) -> Mobility {
        match self.name() {
            "person" | "bird" | "cat" | "dog" | "horse" | "sheep" | "cow" | "elephant" | "bear"
            | "zebra" | "giraffe" => Mobility::Moving,
            "bicycle" | "car" | "motorcycle" | "airplane" | "bus" | "train" | "truck" | "boat"
            | "backpack" | "umbrella" | "handbag" | "tie" | "suitcase" | "frisbee" | "skis"
            | "snowboard" | "sports ball" | "kite" | "baseball bat" | "baseball glove"
            | "skateboard" | "surfboard" | "tennis racket" | "chair" | "laptop" | "cell phone"
            | "book" => Mobility::Movable,
            _ => Mobility::Static,
        }
    }
}

impl fmt::Display for Class {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

const NAMES: [&str; 80] = [
    "person",
    "bicycle",
    "car",
    "motorcycle",
    "airplane",
    "bus",
    "train",
    "truck",
    "boat",
    "traffic light",
    "fire hydrant",
    "stop sign",
    "parking meter",
    "bench",
    "bird",
    "cat",
    "dog",
    "horse",
    "sheep",
    "cow",
    "elephant",
    "bear",
    "zebra",
    "giraffe",
    "backpack",
    "umbrella",
    "handbag",
    "tie",
    "suitcase",
    "frisbee",
    "skis",
    "snowboard",
    "sports ball",
    "kite",
    "baseball bat",
    "baseball glove",
    "skateboard",
    "surfboard",
    "tennis racket",
    "bottle",
    "wine glass",
    "cup",
    "fork",
    "knife",
    "spoon",
    "bowl",
    "banana",
    "apple",
    "sandwich",
    "orange",
    "broccoli",
    "carrot",
    "hot dog",
    "pizza",
    "donut",
    "cake",
    "chair",
    "couch",
    "potted plant",
    "bed",
    "dining table",
    "toilet",
    "tv",
    "laptop",
    "mouse",
    "remote",
    "keyboard",
    "cell phone",
    "microwave",
    "oven",
    "toaster",
    "sink",
    "refrigerator",
    "book",
    "clock",
    "vase",
    "scissors",
    "teddy bear",
    "hair drier",
    "toothbrush",
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn people_and_animals_move_vehicles_may_and_furniture_does_not() {
        let mobility = |name: &str| Class::named(name).map(Class::mobility);
        assert_eq!(mobility("person"), Some(Mobility::Moving));
        assert_eq!(mobility("dog"), Some(Mobility::Moving));
        assert_eq!(mobility("car"), Some(Mobility::Movable));
        assert_eq!(mobility("chair"), Some(Mobility::Movable));
        assert_eq!(mobility("couch"), Some(Mobility::Static));
        assert_eq!(mobility("traffic light"), Some(Mobility::Static));
        assert_eq!(mobility("ghost"), None);
    }

    #[test]
    fn every_index_has_a_name_of_its_own_and_no_other_is_a_class() {
        for index in 0..Class::COUNT {
            let class = Class::from_index(index).expect("within the classes");
            assert_eq!(Class::named(class.name()), Some(class));
        }
        assert_eq!(Class::from_index(Class::COUNT), None);
        assert_eq!(Class::from_index(300), None);
    }
}
