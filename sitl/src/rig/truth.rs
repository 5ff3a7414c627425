//! The truth beside what sensors say.

use maps::time::Stamp;
use nalgebra::Isometry3;
use sensors::ros::vehicle::{
    ODOMETRY, Odometry, TF, TIME_REFERENCE, Transform, encode_tf, encode_time_reference,
};

use super::world::World;
use super::{Rate, Reading, Sensor};
use crate::platform::Platform;
use crate::scene::Scene;

pub(super) fn of(platform: Platform) -> Vec<Box<dyn Sensor>> {
    vec![
        Box::new(Mounts { platform }),
        Box::new(Pose { platform }),
        Box::new(Clock { platform }),
    ]
}

/// The frame of a vehicle, as `tf2` knows it.
pub(super) fn base(platform: Platform) -> &'static str {
    match platform {
        Platform::Uav => "uav/base_link",
        Platform::Ugv => "ugv/base_link",
    }
}

/// Where sensors are on their vehicle: `/tf_static`, once every hour, that is once.
struct Mounts {
    platform: Platform,
}

fn mounts(platform: Platform, scene: &Scene) -> Vec<(&'static str, String, Isometry3<f64>)> {
    let mut mounts = match platform {
        Platform::Uav => {
            let camera = crate::platform::body_from_uav_camera(scene).raw;
            vec![(sensors::message::CAMERA_FRAME.to_owned(), camera)]
        }
        Platform::Ugv => {
            let lidar = crate::lidar::Lidar::rs_32().body_from_sensor;
            let mut mounts = vec![
                ("ugv/lidar".to_owned(), lidar),
                ("ugv/radar".to_owned(), super::scan::body_from_radar()),
            ];
            for (index, name) in crate::platform::UGV_CAMERAS.iter().enumerate() {
                let pose = crate::platform::body_from_ugv_camera(index).raw;
                mounts.push((super::camera::ground_frame(name), pose));
            }
            mounts
        }
    };
    for own in ["imu", "gnss"] {
        mounts.push((format!("{}/{own}", platform.name()), Isometry3::identity()));
    }
    let parent = base(platform);
    mounts
        .into_iter()
        .map(|(child, pose)| (parent, child, pose))
        .collect()
}

impl Sensor for Mounts {
    fn name(&self) -> &'static str {
        ""
    }

    fn rate(&self) -> Rate {
        Rate {
            count: 1,
            span: std::time::Duration::from_hours(1),
        }
    }

    fn read(&mut self, world: &mut World<'_>, at: Stamp, _: f64) -> Vec<Reading> {
        let transforms = mounts(self.platform, world.scene);
        let encode = move |shown| {
            let transforms: Vec<_> = transforms
                .iter()
                .map(|(parent, child, pose)| Transform {
                    parent,
                    child,
                    pose: *pose,
                })
                .collect();
            encode_tf(shown, &transforms)
        };
        vec![Reading::now("/tf_static", &TF, at, encode)]
    }
}

/// Where the vehicle really is: odometry and `/tf`.
struct Pose {
    platform: Platform,
}

impl Sensor for Pose {
    fn name(&self) -> &'static str {
        ""
    }

    fn rate(&self) -> Rate {
        Rate::hz(50)
    }

    fn read(&mut self, world: &mut World<'_>, at: Stamp, _: f64) -> Vec<Reading> {
        let (motion, _) = world.motion(self.platform, at);
        let pose = motion.world_from_body.raw;
        let velocity = pose.rotation.inverse() * motion.velocity.raw;
        let (name, child) = (self.platform.name(), base(self.platform));
        let odometry = move |shown| {
            Odometry {
                at: shown,
                frame_id: "world",
                child_frame_id: child,
                pose,
                velocity,
                rates: motion.rates.raw,
            }
            .encode()
        };
        let tf = move |shown| {
            encode_tf(
                shown,
                &[Transform {
                    parent: "world",
                    child,
                    pose,
                }],
            )
        };
        let topic = format!("/{name}/ground_truth/odom");
        vec![
            Reading::now(topic, &ODOMETRY, at, odometry),
            Reading::now("/tf", &TF, at, tf),
        ]
    }
}

/// What the vehicle's clock shows, and what it should.
struct Clock {
    platform: Platform,
}

impl Sensor for Clock {
    fn name(&self) -> &'static str {
        ""
    }

    fn rate(&self) -> Rate {
        Rate::hz(1)
    }

    fn read(&mut self, _: &mut World<'_>, at: Stamp, _: f64) -> Vec<Reading> {
        let topic = format!("/{}/clock/reference", self.platform.name());
        let encode = move |shown| encode_time_reference(shown, at, "simulation");
        vec![Reading::now(topic, &TIME_REFERENCE, at, encode)]
    }
}
