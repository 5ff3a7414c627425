//! What is under the cursor: the first voxel that is shown there, or the ground.

use maps::frame::{Point, World};
use maps::voxel::{Occupancy, VoxelKey, VoxelMap};

use super::camera::Ray;
use super::mesh::Facing;
use super::scene::{Scene, Surfaces};

/// What a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picked {
    /// Where.
    pub point: Point<World>,
    /// The voxel there; none if it is the ground, the plane through the origin.
    pub voxel: Option<VoxelKey>,
}

/// Farther away than this the ground is sky.
const FARTHEST_M: f64 = 50_000.0;
/// How many voxels that are not shown a ray may pass; there are more than this behind one another in no map.
const MOST_PASSED: usize = 4096;

/// What `ray` meets first of what `scene` shows of `map`: voxels that are cut away or seen from behind do not count.
/// Where it meets none, the ground; its grid hides no voxel, so one below it is preferred.
pub fn pick(map: &VoxelMap, scene: &Scene, ray: Ray) -> Option<Picked> {
    let voxel = first_shown(map, scene, ray).map(|(key, m)| Picked {
        point: ray.at(m),
        voxel: Some(key),
    });
    let ground = || {
        let m = ray.distance_to_height_m(0.0).filter(|m| *m < FARTHEST_M)?;
        Some(Picked {
            point: ray.at(m),
            voxel: None,
        })
    };
    voxel.or_else(ground)
}

fn first_shown(map: &VoxelMap, scene: &Scene, ray: Ray) -> Option<(VoxelKey, f64)> {
    let top = scene.top().unwrap_or(i32::MAX);
    let mut from_m = 0.0;
    if let Some(top) = scene.top() {
        let top_m = f64::from(top) * map.resolution_m();
        if ray.origin.raw.z > top_m {
            // Everything above the cut is air.
            from_m = ray.distance_to_height_m(top_m)?;
        }
    }
    for _ in 0..MOST_PASSED {
        let hit = map.cast_ray(ray.at(from_m), ray.direction, FARTHEST_M)?;
        let hit_m = from_m + hit.distance_m;
        if hit.key.z < top && is_side_shown(map, scene, ray, hit.key, hit_m) {
            return Some((hit.key, hit_m));
        }
        from_m = leaves_m(map, ray, hit.key).max(hit_m) + 1e-6 * map.resolution_m();
    }
    None
}

/// Whether the side through which the ray enters the voxel is drawn.
fn is_side_shown(map: &VoxelMap, scene: &Scene, ray: Ray, key: VoxelKey, enters_m: f64) -> bool {
    if scene.look.surfaces == Surfaces::All {
        return true;
    }
    // The voxel before the side that was crossed last.
    let center = map.center_of(key).raw;
    let from_center = ray.at(enters_m).raw - center;
    let axis = from_center.iamax();
    let mut before = [key.x, key.y, key.z];
    before[axis] += if from_center[axis] > 0.0 { 1 } else { -1 };
    let occupancy = |[x, y, z]: [i32; 3]| map.occupancy(VoxelKey { x, y, z });
    let is_above_cut = scene.top().is_some_and(|top| before[2] >= top);
    if is_above_cut && occupancy(before) == Occupancy::Occupied {
        return true;
    }
    let facing = Facing::of([key.x, key.y, key.z], |at| occupancy(at) == Occupancy::Free);
    !facing.hides(ray.direction.raw, occupancy(before) == Occupancy::Unknown)
}

/// How far along the ray it leaves the voxel.
fn leaves_m(map: &VoxelMap, ray: Ray, key: VoxelKey) -> f64 {
    let half_m = 0.5 * map.resolution_m();
    let center = map.center_of(key).raw;
    (0..3)
        .map(|axis| {
            let direction = ray.direction.raw[axis];
            let side = center[axis] + half_m * direction.signum();
            (side - ray.origin.raw[axis]) / direction
        })
        .filter(|m| m.is_finite())
        .fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use maps::frame::Vector;
    use maps::voxel::{LogOdds, Voxel};

    use super::*;

    const OCCUPIED: Voxel = Voxel::new(LogOdds(70));
    const FREE: Voxel = Voxel::new(LogOdds(-40));

    /// A pillar of ten voxels of 0.1 m on the ground, at the origin, with free space to the west of it.
    fn pillar() -> VoxelMap {
        let mut map = VoxelMap::new(0.1);
        for z in 0..10 {
            map.set_voxel(VoxelKey { x: 0, y: 0, z }, OCCUPIED);
            map.set_voxel(VoxelKey { x: -1, y: 0, z }, FREE);
        }
        map
    }

    fn scene_of(map: &VoxelMap, clip_above_m: Option<f64>, surfaces: Surfaces) -> Scene {
        let mut scene = Scene::default();
        scene.clip_above_m = clip_above_m;
        scene.look.surfaces = surfaces;
        scene.update_map(map, &map.tile_ids());
        scene
    }

    fn ray(from: [f64; 3], towards: [f64; 3]) -> Ray {
        let [from, towards] = [from, towards].map(|[x, y, z]| Point::<World>::new(x, y, z));
        let along = towards - from;
        Ray {
            origin: from,
            direction: Vector::from_raw(along.raw.normalize()),
        }
    }

    #[test]
    fn a_ray_from_above_meets_the_top_and_beside_it_the_ground() {
        let map = pillar();
        let scene = scene_of(&map, None, Surfaces::All);
        let top =
            pick(&map, &scene, ray([0.05, 0.05, 5.0], [0.05, 0.05, 0.0])).expect("the pillar");
        assert_eq!(top.voxel, Some(VoxelKey { x: 0, y: 0, z: 9 }));
        assert!((top.point - Point::new(0.05, 0.05, 1.0)).norm() < 1e-9);
        let ground = pick(&map, &scene, ray([3.0, 4.0, 5.0], [3.5, 4.0, 0.0])).expect("the ground");
        assert_eq!(ground.voxel, None);
        assert!((ground.point - Point::new(3.5, 4.0, 0.0)).norm() < 1e-9);
        assert_eq!(
            pick(&map, &scene, ray([3.0, 4.0, 5.0], [4.0, 4.0, 5.0])),
            None,
            "the sky"
        );
    }

    #[test]
    fn what_is_cut_away_is_not_picked() {
        let map = pillar();
        let scene = scene_of(&map, Some(0.5), Surfaces::All);
        let top =
            pick(&map, &scene, ray([0.05, 0.05, 5.0], [0.05, 0.05, 0.0])).expect("what is left");
        assert_eq!(top.voxel, Some(VoxelKey { x: 0, y: 0, z: 4 }));
        let aside = pick(&map, &scene, ray([-2.0, 0.05, 0.85], [-1.0, 0.05, 0.85]));
        assert_eq!(aside, None, "level, above the cut");
    }

    #[test]
    fn what_is_transparent_from_behind_is_not_picked_from_there() {
        let map = pillar();
        let scene = scene_of(&map, None, Surfaces::Observed);
        let front = ray([-2.0, 0.05, 0.55], [0.0, 0.05, 0.55]);
        assert_eq!(
            pick(&map, &scene, front).and_then(|p| p.voxel),
            Some(VoxelKey { x: 0, y: 0, z: 5 })
        );
        let back = ray([2.0, 0.05, 0.55], [0.0, 0.05, 0.5]);
        assert_eq!(pick(&map, &scene, back).and_then(|p| p.voxel), None);
    }
}
