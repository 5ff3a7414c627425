//! What `companion doctor` looks at before a flight: one line for each check, "ok" or what to do.

use std::collections::BTreeSet;
use std::fmt;
use std::fs;
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

use geodesy::Geodetic;
use maps::camera::{Pinhole, RgbdFrame};
use mavlink_ext::dialect::tandem::{HEARTBEAT_DATA, MavAutopilot, MavType};
use mavlink_ext::link::{Link, LinkError, LinkUri};
use mavlink_ext::presence::companion_heartbeat;
use mavlink_ext::{Address, Encoder, Message};
use perception::Image;
use sensors::RgbdSource;
use slam::Floor;

use crate::clock::{Clock, since_1970};
use crate::config::{DetectorSettings, Settings};
use crate::event::LinkId;
use crate::output;
use crate::pipeline::uav::{FloorFigures, Mapper};
use crate::pipeline::{self, chain, detecting};

/// Less is not enough for the map and the report of a flight.
const LEAST_FREE_BYTES: u64 = 1 << 30;

/// 1 January 2026, in seconds since 1970: a clock before that was never set.
const CLOCK_WAS_NEVER_SET: u64 = 1_767_225_600;

/// One thing looked at.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Check {
    /// What.
    pub name: &'static str,
    /// What was found.
    pub finding: Finding,
}

/// What was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Finding {
    /// In order, with the figures.
    Ok(String),
    /// It flies, but somebody should know.
    Note(String),
    /// What is wrong, and what to do.
    Failed(String),
}

impl fmt::Display for Check {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (verdict, text) = match &self.finding {
            Finding::Ok(text) => ("ok", text),
            Finding::Note(text) => ("note", text),
            Finding::Failed(text) => ("FAIL", text),
        };
        write!(f, "{verdict:4} {}: {text}", self.name)
    }
}

impl Check {
    /// Whether the companion should not fly like this.
    pub fn has_failed(&self) -> bool {
        matches!(self.finding, Finding::Failed(_))
    }

    fn new(name: &'static str, outcome: Result<String, String>) -> Self {
        let finding = outcome.map_or_else(Finding::Failed, Finding::Ok);
        Self { name, finding }
    }
}

/// How often it says that it is there while it listens.
const HEARTBEAT_EVERY: Duration = Duration::from_secs(1);

/// Looks at everything; listens on the links for `listen`.
pub fn examine(settings: &Settings, clock: Clock, listen: Duration, mut tell: impl FnMut(Check)) {
    match pipeline::open_source(&settings.source) {
        Ok(mut source) => {
            tell(check_camera(&source.camera()));
            match check_source(source.as_mut()) {
                Ok((first, text)) => {
                    tell(Check::new("source", Ok(text)));
                    tell(check_floor(&first, source.camera(), settings));
                }
                Err(fault) => tell(Check::new("source", Err(fault))),
            }
        }
        Err(error) => tell(Check::new("source", Err(chain(&error)))),
    }
    if let Some(detector) = &settings.detector {
        tell(Check::new("detector", check_detector(detector, clock)));
    }
    for check in check_links(settings, clock, listen) {
        tell(check);
    }
    tell(check_dialect_path(settings));
    tell(check_origin(settings));
    tell(Check::new("disk", check_disk(&settings.out)));
    tell(Check::new("clock", check_clock(since_1970())));
}

/// The first frame, and what is to be said of the source.
fn check_source(source: &mut dyn RgbdSource) -> Result<(RgbdFrame, String), String> {
    let count = source.frame_count();
    let first = source.next_frame().map_err(|error| chain(&error))?;
    let first = first.ok_or("it has no frames: choose another recording")?;
    let seen = first.depth_m.iter().filter(|&&depth| depth > 0.0).count();
    let share = 100 * seen / first.depth_m.len().max(1);
    if share < 5 {
        return Err(format!(
            "only {share} % of the first frame has depth: check the depth camera and source.depth_factor"
        ));
    }
    let count = match (count, source.live()) {
        (_, Some(_)) => "live".to_owned(),
        (Some(count), None) => format!("{count} frames"),
        (None, None) => "unknown number of frames".to_owned(),
    };
    let truth = source.truth().len();
    let text = format!(
        "{}, {count}, {share} % of the first has depth, {truth} true poses",
        source.name()
    );
    Ok((first, text))
}

/// Heights in the map count from the floor of the first frame.
fn check_floor(first: &RgbdFrame, camera: Pinhole, settings: &Settings) -> Check {
    let mut mapper = Mapper::new(camera, &settings.mapping, None);
    let tracked = mapper.track(first);
    let finding = match (tracked, mapper.floor()) {
        (Err(error), _) => Finding::Failed(chain(&error)),
        (Ok(_), None) => Finding::Note(
            "the map does not start with the first frame: too few features with depth in it".into(),
        ),
        (Ok(_), Some(FloorFigures { floor, .. })) => match floor {
            Floor::Found { .. } => Finding::Ok(format!(
                "{floor}; if that is a table, exclude it with slam.floor_below_m"
            )),
            Floor::Assumed { .. } => Finding::Note(format!(
                "{floor}: start in view of the floor, or measure slam.initial_height_m"
            )),
        },
    };
    Check {
        name: "floor",
        finding,
    }
}

/// Opens it as for a flight, and takes the time of a look.
fn check_detector(settings: &DetectorSettings, clock: Clock) -> Result<String, String> {
    let every = settings.every_frames;
    let detector = detecting::open(settings).map_err(|error| chain(&error))?;
    let pixels = vec![[0; 3]; 640 * 480];
    let image = Image::new(640, 480, &pixels).map_err(|error| chain(&error))?;
    let started = clock.now();
    detector.detect(&image).map_err(|error| chain(&error))?;
    let took_ms = clock.now().since(started).as_secs_f64() * 1e3;
    Ok(format!(
        "{}; a look takes {took_ms:.0} ms, and tracking waits where that is longer than {every} frames",
        settings.weights.display()
    ))
}

fn check_camera(camera: &Pinhole) -> Check {
    let Pinhole {
        width,
        height,
        fx,
        fy,
        cx,
        cy,
        ..
    } = *camera;
    let centered = |center: f64, side: usize| (0.3..0.7).contains(&(center / side as f64));
    let plausible = centered(cx, width)
        && centered(cy, height)
        && (0.9..1.1).contains(&(fx / fy))
        && (0.2..4.0).contains(&(fx / width as f64));
    let text = format!(
        "{width} x {height}, focal length {fx:.1} x {fy:.1}, centre {cx:.1}, {cy:.1} pixels"
    );
    let outcome = if plausible {
        Ok(text)
    } else {
        Err(format!(
            "{text}: that is no common lens; calibrate the camera or correct [camera]"
        ))
    };
    Check::new("camera", outcome)
}

/// Who was heard on a link.
#[derive(Default)]
struct Heard {
    autopilots: BTreeSet<Address>,
    ground_stations: BTreeSet<Address>,
}

impl Heard {
    fn take(&mut self, from: Address, heartbeat: &HEARTBEAT_DATA) {
        if heartbeat.mavtype == MavType::MAV_TYPE_GCS {
            self.ground_stations.insert(from);
        } else if heartbeat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID {
            self.autopilots.insert(from);
        }
    }
}

fn check_links(settings: &Settings, clock: Clock, listen: Duration) -> Vec<Check> {
    let (sender, heartbeats) = sync_channel(64);
    // Both are open at the same time, as in flight.
    let open = |id: LinkId, uri: &Option<LinkUri>| {
        let uri = uri.as_ref()?;
        Some(open_link(id, uri, sender.clone()))
    };
    let autopilot = open(LinkId::Autopilot, &settings.autopilot);
    let ground = open(LinkId::Ground, &settings.ground);
    let own_autopilot = Address {
        component: mavlink_ext::ComponentId(1),
        ..settings.address
    };
    let links: Vec<&Link> = [&autopilot, &ground]
        .into_iter()
        .filter_map(|link| link.as_ref()?.as_ref().ok())
        .collect();
    let mut encoder = Encoder::new(settings.address);
    let beat = || {
        let frame = encoder.encode(&Message::HEARTBEAT(companion_heartbeat()));
        for link in &links {
            // Whether anybody is there to take it is what is being found out.
            let _sent = link.send(&frame);
        }
    };
    let (by_autopilot, by_ground) = hear(&heartbeats, clock, listen, beat, |autopilot, ground| {
        (settings.autopilot.is_none() || autopilot.autopilots.contains(&own_autopilot))
            && (settings.ground.is_none() || !ground.ground_stations.is_empty())
    });
    // A cable that is not plugged in, or a peer that takes no connections.
    let problem = |link: &Link, uri: &LinkUri| {
        let problem = link.problem()?;
        Some(Finding::Failed(format!("{uri}: {problem}")))
    };
    let autopilot = match (autopilot, &settings.autopilot) {
        (Some(Err(error)), _) => Finding::Failed(error),
        (Some(Ok(link)), Some(uri)) => problem(&link, uri).unwrap_or_else(|| {
            judge_autopilot(&by_autopilot, own_autopilot, &uri.to_string(), listen)
        }),
        _ => Finding::Note("no link configured: nothing is told where the vehicle is".into()),
    };
    let ground = match (ground, &settings.ground) {
        (Some(Err(error)), _) => Finding::Failed(error),
        (Some(Ok(link)), Some(uri)) => problem(&link, uri)
            .unwrap_or_else(|| judge_ground(&by_ground, &uri.to_string(), listen)),
        _ => {
            Finding::Failed("no link configured: the map would go nowhere; set links.ground".into())
        }
    };
    vec![
        Check {
            name: "autopilot link",
            finding: autopilot,
        },
        Check {
            name: "ground link",
            finding: ground,
        },
    ]
}

fn judge_ground(heard: &Heard, uri: &str, listen: Duration) -> Finding {
    match heard.ground_stations.first() {
        Some(address) => Finding::Ok(format!("{uri}, ground station {address} heard")),
        None => Finding::Note(format!(
            "{uri}: no ground station heard within {} s: start it, or check that its link is the other end of this one",
            listen.as_secs_f64()
        )),
    }
}

fn judge_autopilot(heard: &Heard, own: Address, uri: &str, listen: Duration) -> Finding {
    if heard.autopilots.contains(&own) {
        return match heard.ground_stations.first() {
            Some(station) => Finding::Note(format!(
                "{uri}: ground station {station} speaks through the autopilot, which drops Tandem's messages: it needs \
                 links.ground too"
            )),
            None => Finding::Ok(format!("{uri}, autopilot {own} heard")),
        };
    }
    let others: Vec<String> = heard.autopilots.iter().map(ToString::to_string).collect();
    Finding::Failed(if others.is_empty() {
        format!(
            "{uri}: autopilot {own} not heard within {} s: check its power, cable and that its telemetry goes to this link",
            listen.as_secs_f64()
        )
    } else {
        format!(
            "{uri}: autopilot {own} not heard, only {}: correct vehicle.system_id",
            others.join(", ")
        )
    })
}

type Heartbeat = (LinkId, Address, HEARTBEAT_DATA);

fn open_link(id: LinkId, uri: &LinkUri, heartbeats: SyncSender<Heartbeat>) -> Result<Link, String> {
    let link = Link::open(&uri.to_string(), move |frame| {
        if let Ok(Message::HEARTBEAT(heartbeat)) = frame.decode() {
            // Full: 64 of them are enough to know who is there.
            let _delivered = heartbeats.try_send((id, frame.from(), heartbeat));
        }
    });
    link.map_err(|error| match error {
        LinkError::Open { .. } => format!(
            "{}: is another companion running, or another program on this port?",
            chain(&error)
        ),
        LinkError::Resolve { .. } => format!(
            "{}: correct the host in [links], or check that names resolve here",
            chain(&error)
        ),
        LinkError::Uri { .. } | LinkError::Key(_) | LinkError::Send { .. } => chain(&error),
    })
}

/// Who is heard on the autopilot's link and on the ground's, until that is enough or the time is over.
///
/// Meanwhile it says with a heartbeat a second that we are there, as in flight: a ground station that listens answers only
/// those it has heard.
fn hear(
    heartbeats: &Receiver<Heartbeat>,
    clock: Clock,
    listen: Duration,
    mut beat: impl FnMut(),
    enough: impl Fn(&Heard, &Heard) -> bool,
) -> (Heard, Heard) {
    let [mut autopilot, mut ground] = [Heard::default(), Heard::default()];
    let mut now = clock.now();
    let deadline = now + listen;
    let mut due = now;
    while now < deadline && !enough(&autopilot, &ground) {
        if now >= due {
            beat();
            due = now + HEARTBEAT_EVERY;
        }
        // A timeout only means that the next heartbeat of ours is due, or all is over.
        if let Ok((link, from, heartbeat)) = heartbeats.recv_timeout(deadline.min(due).since(now)) {
            match link {
                LinkId::Autopilot => autopilot.take(from, &heartbeat),
                LinkId::Ground => ground.take(from, &heartbeat),
            }
        }
        now = clock.now();
    }
    (autopilot, ground)
}

/// Whether our own messages would have to pass through a flight controller, whose router drops unknown ids.
fn check_dialect_path(settings: &Settings) -> Check {
    let outcome = match (&settings.autopilot, &settings.ground) {
        (Some(autopilot), Some(ground)) if lead_to_one_place(autopilot, ground) => Err(format!(
            "links.autopilot ({autopilot}) and links.ground ({ground}) are one place: Tandem's messages would reach the \
             flight controller, which drops them, or come back here; give the ground station its own link"
        )),
        (_, None) => Err("without links.ground Tandem's messages would have to pass through the flight controller, \
             which drops them; give the ground station its own link"
            .to_owned()),
        (_, Some(ground)) => Ok(format!("goes to {ground} only, past the flight controller")),
    };
    Check::new("dialect", outcome)
}

/// Whether two links have an address in common, however it is written. What has no address is told by the link's own check.
fn lead_to_one_place(a: &LinkUri, b: &LinkUri) -> bool {
    let addresses = |uri: &LinkUri| -> Vec<SocketAddr> {
        let found = uri.host_and_port().map(ToSocketAddrs::to_socket_addrs);
        found
            .and_then(Result::ok)
            .map_or(Vec::new(), Iterator::collect)
    };
    let is_serial = |uri: &LinkUri| uri.host_and_port().is_none();
    let b_addresses = addresses(b);
    (is_serial(a) && a.way == b.way)
        || addresses(a)
            .iter()
            .any(|address| b_addresses.contains(address))
}

/// Where the map lies on the earth decides where the ground vehicle drives.
fn check_origin(settings: &Settings) -> Check {
    let finding = match settings.origin {
        Some(Geodetic {
            lat_deg,
            lon_deg,
            alt_m,
        }) => Finding::Ok(format!(
            "{lat_deg:.7}, {lon_deg:.7}, {alt_m:.1} m above the ellipsoid"
        )),
        None => Finding::Note(
            "not configured: the map's origin will be the autopilot's home, its start heading slam.initial_heading_deg".into(),
        ),
    };
    Check {
        name: "origin",
        finding,
    }
}

fn check_disk(out: &Path) -> Result<String, String> {
    let was_there = out.exists();
    let probe = out.join(".doctor");
    output::write_atomically(&probe, |_file| Ok(())).map_err(|error| chain(&error))?;
    fs::remove_file(&probe)
        .map_err(|error| format!("cannot remove {}: {error}", probe.display()))?;
    let space = rustix::fs::statvfs(out)
        .map_err(|error| format!("cannot examine {}: {error}", out.display()))?;
    if !was_there {
        // Looking leaves nothing behind.
        fs::remove_dir(out).map_err(|error| format!("cannot remove {}: {error}", out.display()))?;
    }
    let free = space.f_bavail.saturating_mul(space.f_frsize);
    let text = format!(
        "{:.1} GiB free in {}",
        free as f64 / f64::from(1 << 30),
        out.display()
    );
    if free < LEAST_FREE_BYTES {
        return Err(format!(
            "{text}: make room for at least 1 GiB, or choose another output.dir"
        ));
    }
    Ok(text)
}

fn check_clock(since_1970: Duration) -> Result<String, String> {
    let seconds = since_1970.as_secs();
    if seconds < CLOCK_WAS_NEVER_SET {
        return Err(format!(
            "the calendar clock is {seconds} s after 1970, so it was never set: connect to an NTP server or GPS"
        ));
    }
    let [year, month, day] = civil_date(seconds / 86_400);
    let [hours, minutes] = [seconds / 3600 % 24, seconds / 60 % 60];
    Ok(format!(
        "{year}-{month:02}-{day:02} {hours:02}:{minutes:02} UTC"
    ))
}

/// Year, month and day of the Gregorian calendar, so many days after 1 January 1970. Years are counted from March, so
/// that the leap day is the last of its year, in eras of 400 years, which all have the same days.
///
/// - H. Hinnant, *chrono-compatible low-level date algorithms*, 2013.
fn civil_date(days_since_1970: u64) -> [u64; 3] {
    const ERA: u64 = 146_097;
    let days = days_since_1970 + 719_468;
    let day_of_era = days % ERA;
    let leap_days = day_of_era / 1460 + day_of_era / (ERA - 1);
    let year_of_era = (day_of_era - leap_days + day_of_era / 36_524) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = (month_from_march + 2) % 12 + 1;
    let year = year_of_era + 400 * (days / ERA) + u64::from(month <= 2);
    [year, month, day]
}

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;
    use std::thread;

    use mavlink_ext::presence::ground_station_heartbeat;

    use super::*;
    use crate::config::{Config, DetectorKind};

    #[test]
    fn a_ground_station_that_answers_only_those_it_has_heard_is_heard() {
        let station = UdpSocket::bind("127.0.0.1:0").expect("a port");
        let port = station.local_addr().expect("bound").port();
        let answer = move || {
            let mut datagram = [0; 512];
            let (_, companion) = station.recv_from(&mut datagram).expect("a heartbeat");
            let beat = Message::HEARTBEAT(ground_station_heartbeat());
            let frame = Encoder::new(Address::new(255, 190)).encode(&beat);
            station.send_to(frame.bytes(), companion).expect("loopback");
        };
        let answer = thread::Builder::new()
            .name("station".into())
            .spawn(answer)
            .expect("a thread");
        let mut config = Config::default();
        config.source.path = "flight.mcap".into();
        config.links.autopilot.clear();
        config.links.ground = format!("udpout:127.0.0.1:{port}");
        let settings = config.check().expect("sound");
        let checks = check_links(&settings, Clock::start(), Duration::from_secs(30));
        answer.join().expect("it has answered");
        let ground = checks.last().map(ToString::to_string).unwrap_or_default();
        assert!(ground.contains("ground station 255/190 heard"), "{ground}");
    }

    #[test]
    fn weights_that_are_not_there_are_told_by_name() {
        let settings = DetectorSettings {
            kind: DetectorKind::Yolox,
            weights: "nowhere/yolox.onnx".into(),
            least_score: 0.3,
            every_frames: 3,
        };
        let told = check_detector(&settings, Clock::start());
        assert!(told.is_err_and(|text| text.contains("nowhere/yolox.onnx")));
    }

    #[test]
    fn days_become_dates() {
        assert_eq!(civil_date(0), [1970, 1, 1]);
        assert_eq!(civil_date(11_016), [2000, 2, 29]);
        assert_eq!(civil_date(11_017), [2000, 3, 1]);
        assert_eq!(civil_date(20_779), [2026, 11, 22]);
    }

    #[test]
    fn a_clock_that_was_never_set_is_told() {
        assert!(check_clock(Duration::from_secs(5)).is_err_and(|text| text.contains("NTP")));
        let now = check_clock(Duration::from_secs(1_795_331_272));
        assert_eq!(now.as_deref(), Ok("2026-11-22 07:07 UTC"));
    }

    #[track_caller]
    fn check_path_of_dialect(autopilot: &str, ground: &str, words: Option<&str>) {
        let mut config = Config::default();
        config.source.path = "flight.mcap".into();
        config.links.autopilot = autopilot.into();
        config.links.ground = ground.into();
        let check = check_dialect_path(&config.check().expect("sound"));
        assert_eq!(check.has_failed(), words.is_some(), "{check}");
        assert!(
            check
                .to_string()
                .contains(words.unwrap_or("past the flight controller")),
            "{check}"
        );
    }

    #[test]
    fn a_dialect_that_would_pass_through_the_flight_controller_is_told() {
        check_path_of_dialect("udpin:127.0.0.1:14561", "udpout:127.0.0.1:14550", None);
        let same = "udpin:127.0.0.1:14561";
        check_path_of_dialect(same, same, Some("its own link"));
        check_path_of_dialect(same, "", Some("its own link"));
        // Straight back to ourselves, and written in another way.
        check_path_of_dialect(same, "udpout:localhost:14561", Some("one place"));
    }

    #[test]
    fn a_camera_with_a_misplaced_centre_is_told() {
        let camera = Pinhole {
            width: 640,
            height: 480,
            fx: 525.0,
            fy: 525.0,
            cx: 319.5,
            cy: 239.5,
            distortion: [0.0; 5],
        };
        assert!(!check_camera(&camera).has_failed());
        assert!(check_camera(&Pinhole { cx: 10.0, ..camera }).has_failed());
        assert!(
            check_camera(&Pinhole {
                fy: 300.0,
                ..camera
            })
            .has_failed()
        );
    }
}
