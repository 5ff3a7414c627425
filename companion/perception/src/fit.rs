//! How an image is laid into the input of a network, and how boxes come back.

use crate::detection::Detection;
use crate::image::Image;

/// Scale from the image to the network's input, across and down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fit {
    scale: [f32; 2],
    /// Size of the image, and of the input, in pixels: width and height.
    image: [usize; 2],
    input: [usize; 2],
}

impl Fit {
    /// The whole image in the upper left of the input, its shape kept.
    pub(crate) fn letterbox(image: &Image<'_>, input: [usize; 2]) -> Self {
        let mut fit = Self::stretch(image, input);
        let scale = fit.scale[0].min(fit.scale[1]);
        fit.scale = [scale; 2];
        fit
    }

    /// The whole image over the whole input, whatever becomes of its shape.
    pub(crate) fn stretch(image: &Image<'_>, input: [usize; 2]) -> Self {
        let size = [image.width, image.height];
        Self {
            scale: std::array::from_fn(|i| input[i] as f32 / size[i] as f32),
            image: size,
            input,
        }
    }

    /// The input's values, plane by plane in the order blue, green, red, each from 0 to 255 times `gain`; `padding`
    /// where the image does not reach.
    pub(crate) fn planes(&self, image: &Image<'_>, gain: f32, padding: f32) -> Vec<f32> {
        let [across, down] = self.input;
        let area = across * down;
        let mut planes = vec![padding * gain; 3 * area];
        let filled: [usize; 2] = std::array::from_fn(|i| {
            let reach = (self.image[i] as f32 * self.scale[i]).round() as usize;
            reach.clamp(1, self.input[i])
        });
        for row in 0..filled[1] {
            let y = (row as f32 + 0.5) / self.scale[1] - 0.5;
            for column in 0..filled[0] {
                let x = (column as f32 + 0.5) / self.scale[0] - 0.5;
                let [red, green, blue] = image.at(x, y);
                for (plane, value) in [blue, green, red].into_iter().enumerate() {
                    planes[plane * area + row * across + column] = gain * value;
                }
            }
        }
        planes
    }

    /// A detection in pixels of the input as one in the image, cut off at its rim; `None` where nothing sensible is left.
    pub(crate) fn back(&self, found: Detection) -> Option<Detection> {
        let sane = found.bounds_px.iter().all(|v| v.is_finite())
            && found.score.is_finite()
            && (0.0..=1.0).contains(&found.score);
        if !sane {
            return None;
        }
        let bounds_px: [f32; 4] = std::array::from_fn(|i| {
            let axis = i % 2;
            (found.bounds_px[i] / self.scale[axis]).clamp(0.0, self.image[axis] as f32)
        });
        let [left, top, right, bottom] = bounds_px;
        (right - left >= 1.0 && bottom - top >= 1.0).then_some(Detection { bounds_px, ..found })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::class::Class;
    use proptest::prelude::*;

    fn found(bounds_px: [f32; 4], score: f32) -> Detection {
        Detection {
            class: Class::from_index(0).expect("a class"),
            score,
            bounds_px,
        }
    }

    #[test]
    fn a_letterbox_keeps_the_shape_and_pads_below_a_wide_image() {
        let pixels = vec![[10, 20, 30]; 8 * 4];
        let image = Image::new(8, 4, &pixels).expect("as many as needed");
        let fit = Fit::letterbox(&image, [4, 4]);
        let planes = fit.planes(&image, 1.0, 114.0);
        for (plane, value) in [30.0, 20.0, 10.0].into_iter().enumerate() {
            let plane = &planes[16 * plane..16 * (plane + 1)];
            assert_eq!(plane[..8].to_vec(), vec![value; 8], "blue, green, red");
            assert_eq!(plane[8..].to_vec(), vec![114.0; 8], "the padding");
        }
        let back = fit
            .back(found([1.0, 0.5, 3.0, 1.5], 0.5))
            .map(|d| d.bounds_px);
        assert_eq!(back, Some([2.0, 1.0, 6.0, 3.0]));
    }

    #[test]
    fn a_stretched_image_fills_the_input() {
        let pixels = vec![[255; 3]; 8 * 4];
        let image = Image::new(8, 4, &pixels).expect("as many as needed");
        let fit = Fit::stretch(&image, [2, 2]);
        assert_eq!(fit.planes(&image, 1.0 / 255.0, 0.0), vec![1.0; 12]);
        let back = fit
            .back(found([0.0, 1.0, 1.0, 2.0], 1.0))
            .map(|d| d.bounds_px);
        assert_eq!(back, Some([0.0, 2.0, 4.0, 4.0]));
    }

    proptest! {
        #[test]
        fn what_comes_back_is_within_the_image_whatever_the_network_says(
            bounds in prop::array::uniform4(prop_oneof![any::<f32>(), -50.0f32..500.0]),
            score in prop_oneof![any::<f32>(), 0.0f32..1.0],
        ) {
            let pixels = vec![[0; 3]; 64 * 48];
            let image = Image::new(64, 48, &pixels).expect("as many as needed");
            let fit = Fit::letterbox(&image, [416, 416]);
            if let Some(d) = fit.back(found(bounds, score)) {
                let [left, top, right, bottom] = d.bounds_px;
                prop_assert!(0.0 <= left && left < right && right <= 64.0);
                prop_assert!(0.0 <= top && top < bottom && bottom <= 48.0);
                prop_assert!((0.0..=1.0).contains(&d.score));
            }
        }
    }
}
