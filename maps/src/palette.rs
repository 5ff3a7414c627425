//! Colours with a meaning: classes, and low to high.
//!
//! A class is told apart by colour in files that know only colours, and in pictures. Its colour is that of the PASCAL VOC
//! colour map: bit `3 i`, `3 i + 1` and `3 i + 2` of the class become bit `7 - i` of red, green and blue.
//!
//! ```text
//! class   0            1          2          3            4          5            6            7              8
//! colour  (none)       (128,0,0)  (0,128,0)  (128,128,0)  (0,0,128)  (128,0,128)  (0,128,128)  (128,128,128)  (64,0,0)  …
//! ```
//!
//! No two of the 256 are alike, all differ in the upper five bits that a voxel keeps, and none is the white by which `OctoMap`
//! says that there is no colour.
//!
//! - M. Everingham et al., *The PASCAL visual object classes challenge: a retrospective*, IJCV 111, 2015, and the development
//!   kit's `VOCcolormap`.

mod ramp;

pub use ramp::ramp;

use crate::voxel::{ClassId, Rgb};

/// The colour of a class; `None` for [`ClassId::NONE`].
pub fn color_of(ClassId(class): ClassId) -> Option<Rgb> {
    let channel = |first: u8| {
        (0..3).fold(0, |sum, i| {
            let bit = first + 3 * i;
            sum | (class.checked_shr(bit.into()).unwrap_or(0) & 1) << (7 - i)
        })
    };
    (class != 0).then(|| Rgb([channel(0), channel(1), channel(2)]))
}

/// The class of exactly this colour; `None` if there is none, as for mixed colours.
pub fn class_of(Rgb([red, green, blue]): Rgb) -> Option<ClassId> {
    let class = (0..3).fold(0, |sum, i| {
        let bit = |channel: u8| u16::from(channel >> (7 - i) & 1);
        sum | (bit(red) | bit(green) << 1 | bit(blue) << 2) << (3 * i)
    });
    let class = ClassId(u8::try_from(class).ok()?);
    (color_of(class) == Some(Rgb([red, green, blue]))).then_some(class)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_class_has_a_colour_of_its_own_in_five_bits() {
        let mut seen = std::collections::BTreeSet::new();
        for class in (1..=255).map(ClassId) {
            let color = color_of(class).expect("a class");
            assert_eq!(class_of(color), Some(class));
            assert!(
                seen.insert(color.0.map(|c| c >> 3)),
                "{class:?} shares its colour"
            );
            assert_ne!(color.0, [255; 3]);
        }
        assert_eq!(color_of(ClassId::NONE), None);
    }

    #[test]
    fn the_first_classes_are_coloured_as_documented() {
        let colors = [1, 2, 3, 4, 8, 255].map(|c| color_of(ClassId(c)).map(|c| c.0));
        let expected = [
            [128, 0, 0],
            [0, 128, 0],
            [128, 128, 0],
            [0, 0, 128],
            [64, 0, 0],
            [224, 224, 192],
        ];
        assert_eq!(colors, expected.map(Some));
    }

    #[test]
    fn other_colours_are_no_class() {
        for color in [
            [0, 0, 0],
            [255, 255, 255],
            [128, 1, 0],
            [100, 100, 100],
            [0, 0, 32],
        ] {
            assert_eq!(class_of(Rgb(color)), None, "{color:?}");
        }
    }
}
