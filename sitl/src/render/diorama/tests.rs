use super::*;
use crate::scene::Name;

const AT: Stamp = Stamp::from_nanos(8_000_000_000);

fn baked(name: Name) -> (Scene, Diorama) {
    let scene = Scene::generate(name, 1100);
    let diorama = Diorama::new(&Stage::new(&scene));
    (scene, diorama)
}

#[test]
fn every_face_of_every_scene_is_there_with_the_side_outwards_from_which_it_is_seen() {
    for name in Name::STREETS.into_iter().chain([Name::Room]) {
        let (scene, diorama) = baked(name);
        let area = |p: [Vector3<f64>; 3]| (p[1] - p[0]).cross(&(p[2] - p[0])) / 2.0;
        let sum = diorama.still.chunks(3).map(|corners| {
            let at = [0, 1, 2].map(|i| Vector3::from(corners[i].position.map(f64::from)));
            area(at)
        });
        let sum: Vector3<f64> = sum.sum();
        let expected = scene.still().iter().map(|face| {
            let normal = face.edge_u.raw.cross(&face.edge_v.raw);
            normal * ((1.0 + face.top[1] - face.top[0]) / 2.0)
        });
        let expected: Vector3<f64> = expected.sum();
        // Areas with their directions, summed in single precision over thousands of square metres.
        assert!((sum - expected).norm() < 1.0, "{name}: {sum} {expected}");
        let fits = |uv: &[f32; 2]| uv.iter().all(|c| (0.0..=1.0).contains(c));
        assert!(
            diorama.still.iter().all(|vertex| fits(&vertex.uv)),
            "{name}"
        );
        assert!(diorama.texel_m < 0.15, "{name}: {} m", diorama.texel_m);
    }
}

#[test]
fn what_moves_is_elsewhere_a_second_later_and_as_many_triangles() {
    let (scene, diorama) = baked(Name::UrbanArterial);
    let now = diorama.moving(&scene, AT);
    let later = diorama.moving(&scene, AT + std::time::Duration::from_secs(1));
    assert!(now.len() > 1000 && now.len().is_multiple_of(3));
    assert!(now != later);
    assert!(now == diorama.moving(&scene, AT), "a function of time");
}

#[test]
fn the_texture_shows_what_the_camera_shows() {
    // The road before the ground vehicle: asphalt in the sun or in the shade, the same in both.
    let (scene, diorama) = baked(Name::ResidentialAlley);
    let stage = Stage::new(&scene);
    let lens = crate::platform::ugv_lens();
    let pose = crate::platform::ugv(&scene, AT) * crate::platform::body_from_ugv_camera(0);
    let picture = stage.at(AT).picture(&lens, pose);
    let still = |i: &usize| picture.depth_m[*i] > 3.0 && picture.depth_m[*i] < 12.0;
    let (mut off, mut count) = (0.0, 0);
    for i in (0..picture.rgb.len()).step_by(97).filter(still) {
        let pixel = [(i % lens.width) as f64, (i / lens.width) as f64];
        let p = pose * lens.unproject(pixel, f64::from(picture.depth_m[i]));
        let Some(colour) = texture_at(&diorama, p.raw) else {
            continue;
        };
        let grey = |rgb: [u8; 3]| rgb.iter().map(|c| f64::from(*c)).sum::<f64>() / 3.0;
        off += (grey(colour) - grey(picture.rgb[i])).abs();
        count += 1;
    }
    assert!(count > 100, "{count}");
    // Texels are coarser than pixels, and air and shadows of what moves are not in them.
    assert!(off / f64::from(count) < 16.0, "{}", off / f64::from(count));
}

/// The colour of the triangle that a place on still surfaces lies in.
fn texture_at(diorama: &Diorama, p: Point3<f64>) -> Option<[u8; 3]> {
    diorama.still.chunks(3).find_map(|corners| {
        let [a, b, c] = [0, 1, 2].map(|i| Vector3::from(corners[i].position.map(f64::from)));
        let normal = (b - a).cross(&(c - a));
        let area = normal.norm_squared();
        let from = p.coords - a;
        if area < 1e-12 || (from.dot(&normal) / area.sqrt()).abs() > 1e-3 {
            return None;
        }
        let share = |edge: Vector3<f64>| edge.cross(&from).dot(&normal) / area;
        let (v, w) = (-share(c - a), share(b - a));
        if v < 0.0 || w < 0.0 || v + w > 1.0 {
            return None;
        }
        let [width, height] = diorama.atlas.size;
        let uv = [0, 1].map(|i| {
            let of = |k: usize| f64::from(corners[k].uv[i]);
            of(0) + (of(1) - of(0)) * v + (of(2) - of(0)) * w
        });
        let [x, y] = [uv[0] * width as f64, uv[1] * height as f64].map(|c| c as usize);
        let texel = diorama.atlas.pixels[y * width + x];
        let is_textured = corners[0].colour == [255; 4];
        is_textured.then_some([texel[0], texel[1], texel[2]])
    })
}
