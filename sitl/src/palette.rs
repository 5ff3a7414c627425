//! What cameras see and what is true of it, as colours to look at: for the contact sheet and the viewer alike.

mod above;
mod canvas;

use std::collections::BTreeMap;

pub use above::Above;
pub use canvas::Canvas;

use crate::noise::{at_cell, unit};
use crate::render::Picture;
use crate::scene::{Instance, Scene};
use crate::truth::Sight;

/// The picture as the camera delivers it.
pub fn colours(picture: &Picture) -> Canvas {
    Canvas::new(picture.width, picture.height, picture.rgb.clone())
}

/// Classes as colours, darker where a surface is seen at a slant.
pub fn classes(scene: &Scene, picture: &Picture) -> Canvas {
    faced(picture, |instance| scene.class_of(instance).colour())
}

/// Each thing in a colour of its own, darker where a surface is seen at a slant; nothing is black.
pub fn instances(picture: &Picture) -> Canvas {
    faced(picture, |instance| {
        if instance == Instance::NOTHING {
            return [0; 3];
        }
        let channel = |what| 70.0 + 185.0 * unit(at_cell(i32::from(instance.0), what, 0x1257));
        [1, 2, 3].map(|what| channel(what) as u8)
    })
}

/// Road users by how much of them is hidden from the cameras of these sights: green where all of it is seen, red where next
/// to nothing is. Everything else is the picture without colour, dimmed.
pub fn occlusions(scene: &Scene, picture: &Picture, sights: &BTreeMap<Instance, Sight>) -> Canvas {
    let pixels = picture.instance.iter().zip(&picture.rgb);
    let colour = |(instance, rgb): (&Instance, &[u8; 3])| {
        if scene.class_of(*instance).is_traffic() {
            return hidden_share(sights.get(instance).map_or(1.0, |sight| sight.occlusion()));
        }
        let grey: u16 = rgb.iter().copied().map(u16::from).sum();
        [(grey / 6) as u8; 3]
    };
    Canvas::new(picture.width, picture.height, pixels.map(colour).collect())
}

/// Depth as brightness: near is bright, nothing is black.
pub fn depths(picture: &Picture) -> Canvas {
    let colour = |depth_m: &f32| {
        let near = if *depth_m > 0.0 {
            (4.0 / depth_m).min(1.0).sqrt()
        } else {
            0.0
        };
        [near, near * near.sqrt(), 0.25 + 0.5 * (1.0 - near)].map(|c| (c * 255.0) as u8)
    };
    let pixels = picture.depth_m.iter().map(colour).collect();
    Canvas::new(picture.width, picture.height, pixels)
}

/// From green (nothing of it is hidden) to red (all of it).
fn hidden_share(hidden: f64) -> [u8; 3] {
    [hidden, 1.0 - hidden, 0.15].map(|c| (c * 255.0) as u8)
}

fn faced(picture: &Picture, of: impl Fn(Instance) -> [u8; 3]) -> Canvas {
    let pixels = picture.instance.iter().zip(&picture.facing);
    let colour = |(instance, facing): (&Instance, &f32)| {
        let shade = if *instance == Instance::NOTHING {
            1.0
        } else {
            0.55 + 0.45 * facing
        };
        of(*instance).map(|c| (f32::from(c) * shade) as u8)
    };
    Canvas::new(picture.width, picture.height, pixels.map(colour).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Name;
    use maps::time::Stamp;

    fn picture(instance: &[Instance]) -> Picture {
        let pixels = instance.len();
        Picture {
            at: Stamp::ZERO,
            width: pixels,
            height: 1,
            rgb: vec![[90, 120, 150]; pixels],
            depth_m: vec![4.0; pixels],
            facing: vec![1.0; pixels],
            instance: instance.to_vec(),
        }
    }

    #[test]
    fn each_thing_has_a_colour_of_its_own_and_nothing_is_black() {
        let all: Vec<_> = (0..50).map(Instance).collect();
        let seen = instances(&picture(&all));
        let distinct: std::collections::BTreeSet<_> = seen.pixels().iter().collect();
        assert_eq!(distinct.len(), 50);
        assert_eq!(seen.pixels()[0], [0; 3]);
    }

    #[test]
    fn road_users_are_green_to_red_by_what_is_hidden_of_them_and_all_else_is_grey() {
        let scene = Scene::generate(Name::Room, 1);
        let [all, half, unseen] = [0, 1, 2].map(|i| Instance(Instance::FIRST_MOVER.0 + i));
        let sight = |visible| Sight { visible, alone: 10 };
        let sights = [(all, sight(10)), (half, sight(5))].into();
        let row = [Instance::FLOOR, all, half, unseen];
        let seen = occlusions(&scene, &picture(&row), &sights);
        assert_eq!(
            seen.pixels(),
            [[60; 3], [0, 255, 38], [127, 127, 38], [255, 0, 38]]
        );
    }

    #[test]
    fn what_is_near_is_bright_and_nothing_is_dark() {
        let mut three = picture(&[Instance::FLOOR; 3]);
        three.depth_m = vec![2.0, 30.0, 0.0];
        let [near, far, none] = [0, 1, 2].map(|i| u16::from(depths(&three).pixels()[i][0]));
        assert!(near > 2 * far && far > none, "{near} {far} {none}");
    }
}
