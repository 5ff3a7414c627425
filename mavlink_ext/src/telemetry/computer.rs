//! `ONBOARD_COMPUTER_STATUS`: how an onboard computer does.
//!
//! Nothing here reads `/proc` or `/sys`: the owner does, and leaves out what its board does not tell.
//! <https://mavlink.io/en/messages/common.html#ONBOARD_COMPUTER_STATUS>

use std::time::Duration;

use maps::time::Stamp;

use crate::dialect::tandem::{ComputerStatusFlags, ONBOARD_COMPUTER_STATUS_DATA};

/// Bytes of the units that the message counts in.
const MEBIBYTE: u64 = 1 << 20;
const KIBIBYTE: f64 = 1024.0;

/// What is known of a computer; by default, nothing. Loads are shares, 0 to 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Computer {
    /// What it is there for.
    pub role: Role,
    /// Since the computer, not the program, has started.
    pub uptime: Duration,
    /// Load of each processor core.
    pub cores: [Option<f64>; 8],
    /// Load of all cores together in each of the last ten tenths of a second, the oldest first.
    pub recent_load: [Option<f64>; 10],
    /// Load of each graphics processor.
    pub gpus: [Option<f64>; 4],
    /// Load of all graphics processors together, as [`Self::recent_load`].
    pub recent_gpu_load: [Option<f64>; 10],
    /// Temperature of the board, in degrees Celsius.
    pub board_celsius: Option<f64>,
    /// Temperature of each core, in degrees Celsius.
    pub core_celsius: [Option<f64>; 8],
    /// Fans, in turns per minute.
    pub fans_rpm: [Option<f64>; 4],
    /// Main memory.
    pub memory: Option<Usage>,
    /// Disks and cards.
    pub storage: [Option<Storage>; 4],
    /// Network interfaces and serial ports.
    pub links: [Option<ComputerLink>; 6],
    /// Whether its voltage is low, it runs slower than it could, or its disk is full.
    pub warnings: Option<ComputerStatusFlags>,
}

/// What an onboard computer is there for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Role {
    /// Flies or drives the mission.
    #[default]
    Mission,
    /// Takes over when the first one fails.
    Backup,
    /// Computes.
    Compute,
    /// Serves a payload.
    Payload,
}

/// How much of something is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Usage {
    /// Bytes that are used.
    pub used_bytes: u64,
    /// Bytes that there are.
    pub total_bytes: u64,
}

/// A disk or card.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Storage {
    /// What it is.
    pub kind: Option<StorageKind>,
    /// How full it is.
    pub usage: Option<Usage>,
}

/// What files are kept on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StorageKind {
    /// A hard disk.
    HardDisk = 0,
    /// A solid-state disk.
    SolidState = 1,
    /// eMMC.
    Emmc = 2,
    /// An SD card that stays in.
    FixedCard = 3,
    /// An SD card that can be taken out.
    Card = 4,
}

/// Traffic on a link, in bytes per second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComputerLink {
    /// `link_type`: 0 to 9 serial ports, 10 to 19 wired networks, 20 to 29 Wi-Fi, 30 to 39 radios from point to point, 40 to 49
    /// meshes.
    pub kind: u32,
    /// Sent.
    pub sent: Option<f64>,
    /// Received.
    pub received: Option<f64>,
    /// What could be sent.
    pub capacity_to_send: Option<f64>,
    /// What could be received.
    pub capacity_to_receive: Option<f64>,
}

impl Computer {
    /// The message, at this moment on our clock. Whatever is no number is not known.
    pub fn message(&self, now: Stamp) -> ONBOARD_COMPUTER_STATUS_DATA {
        let disks = self.storage.map(|disk| disk.and_then(|disk| disk.usage));
        let disk_kind = |disk: Option<Storage>| disk.and_then(|disk| disk.kind);
        let rate = |of: fn(&ComputerLink) -> Option<f64>| {
            (self.links).map(|link| kibibytes(link.as_ref().and_then(of)))
        };
        ONBOARD_COMPUTER_STATUS_DATA {
            time_usec: now.as_nanos() / 1000,
            uptime: u32::try_from(self.uptime.as_millis()).unwrap_or(u32::MAX),
            ram_usage: mebibytes(self.memory, |usage| usage.used_bytes),
            ram_total: mebibytes(self.memory, |usage| usage.total_bytes),
            storage_type: (self.storage)
                .map(|disk| disk_kind(disk).map_or(u32::MAX, |kind| kind as u32)),
            storage_usage: disks.map(|disk| mebibytes(disk, |usage| usage.used_bytes)),
            storage_total: disks.map(|disk| mebibytes(disk, |usage| usage.total_bytes)),
            // The type has no value for "none"; this one is of no kind, where 0 would be a serial port.
            link_type: self
                .links
                .map(|link| link.map_or(u32::MAX, |link| link.kind)),
            link_tx_rate: rate(|link| link.sent),
            link_rx_rate: rate(|link| link.received),
            link_tx_max: rate(|link| link.capacity_to_send),
            link_rx_max: rate(|link| link.capacity_to_receive),
            fan_speed: self.fans_rpm.map(turns),
            mavtype: self.role.to_wire(),
            cpu_cores: self.cores.map(percent),
            cpu_combined: self.recent_load.map(percent),
            gpu_cores: self.gpus.map(percent),
            gpu_combined: self.recent_gpu_load.map(percent),
            temperature_board: degrees(self.board_celsius),
            temperature_core: self.core_celsius.map(degrees),
            status_flags: self.warnings.unwrap_or(ComputerStatusFlags::empty()),
        }
    }
}

impl Role {
    fn to_wire(self) -> u8 {
        match self {
            Self::Mission => 0,
            Self::Backup => 1,
            Self::Compute => 3,
            Self::Payload => 6,
        }
    }
}

/// What is known, and a number.
fn known(value: Option<f64>) -> Option<f64> {
    value.filter(|value| !value.is_nan())
}

fn percent(share: Option<f64>) -> u8 {
    known(share).map_or(u8::MAX, |share| {
        (share * 100.0).clamp(0.0, 100.0).round() as u8
    })
}

/// The greatest value means "unknown".
fn degrees(celsius: Option<f64>) -> i8 {
    let (least, most) = (f64::from(i8::MIN), f64::from(i8::MAX - 1));
    known(celsius).map_or(i8::MAX, |celsius| celsius.clamp(least, most).round() as i8)
}

fn turns(rpm: Option<f64>) -> i16 {
    let most = f64::from(i16::MAX - 1);
    known(rpm).map_or(i16::MAX, |rpm| rpm.clamp(-most, most).round() as i16)
}

fn mebibytes(usage: Option<Usage>, of: fn(Usage) -> u64) -> u32 {
    usage.map_or(u32::MAX, |usage| {
        u32::try_from(of(usage) / MEBIBYTE).map_or(u32::MAX - 1, |size| size.min(u32::MAX - 1))
    })
}

fn kibibytes(bytes_per_second: Option<f64>) -> u32 {
    let most = f64::from(u32::MAX - 1);
    known(bytes_per_second).map_or(u32::MAX, |rate| {
        (rate / KIBIBYTE).clamp(0.0, most).round() as u32
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn what_is_not_known_has_the_values_of_the_protocol() {
        let message = Computer::default().message(Stamp::from_nanos(7_000));
        assert_eq!(message.time_usec, 7);
        assert_eq!(message.cpu_cores, [u8::MAX; 8]);
        assert_eq!(message.cpu_combined, [u8::MAX; 10]);
        assert_eq!(message.gpu_cores, [u8::MAX; 4]);
        assert_eq!(message.gpu_combined, [u8::MAX; 10]);
        assert_eq!(message.temperature_board, i8::MAX);
        assert_eq!(message.temperature_core, [i8::MAX; 8]);
        assert_eq!(message.fan_speed, [i16::MAX; 4]);
        assert_eq!([message.ram_usage, message.ram_total], [u32::MAX; 2]);
        for storage in [
            message.storage_type,
            message.storage_usage,
            message.storage_total,
        ] {
            assert_eq!(storage, [u32::MAX; 4]);
        }
        for link in [
            message.link_type,
            message.link_tx_rate,
            message.link_rx_rate,
            message.link_tx_max,
            message.link_rx_max,
        ] {
            assert_eq!(link, [u32::MAX; 6]);
        }
        assert!(message.status_flags.is_empty());
    }

    #[test]
    fn what_is_known_is_in_the_units_of_the_protocol() {
        let usage = Usage {
            used_bytes: 3 << 30,
            total_bytes: 8 << 30,
        };
        let mut computer = Computer {
            role: Role::Compute,
            uptime: Duration::from_secs(90),
            board_celsius: Some(-12.4),
            memory: Some(usage),
            warnings: Some(ComputerStatusFlags::COMPUTER_STATUS_FLAGS_DISK_FULL),
            ..Computer::default()
        };
        computer.cores[1] = Some(0.256);
        computer.recent_load[9] = Some(1.0);
        computer.core_celsius[0] = Some(64.6);
        computer.fans_rpm[0] = Some(2400.0);
        computer.storage[0] = Some(Storage {
            kind: Some(StorageKind::Card),
            usage: Some(usage),
        });
        computer.links[2] = Some(ComputerLink {
            kind: 20,
            sent: Some(128.0 * 1024.0),
            received: None,
            capacity_to_send: Some(1e7),
            capacity_to_receive: None,
        });
        let message = computer.message(Stamp::ZERO);
        assert_eq!((message.mavtype, message.uptime), (3, 90_000));
        assert_eq!(message.temperature_board, -12);
        assert_eq!((message.ram_usage, message.ram_total), (3072, 8192));
        assert_eq!(message.cpu_cores[..3], [u8::MAX, 26, u8::MAX]);
        assert_eq!(message.cpu_combined[9], 100);
        assert_eq!(message.temperature_core[0], 65);
        assert_eq!(message.fan_speed[0], 2400);
        assert_eq!(
            (message.storage_type[0], message.storage_usage[0]),
            (4, 3072)
        );
        assert_eq!((message.link_type[2], message.link_tx_rate[2]), (20, 128));
        assert_eq!(
            (message.link_rx_rate[2], message.link_tx_max[2]),
            (u32::MAX, 9766)
        );
        assert_eq!(message.status_flags.bits(), 8);
    }

    proptest! {
        #[test]
        fn a_known_value_is_never_taken_for_unknown_and_no_number_is(value in any::<f64>(), bytes in any::<u64>()) {
            let is_known = !value.is_nan();
            prop_assert_eq!(percent(Some(value)) != u8::MAX, is_known);
            prop_assert_eq!(degrees(Some(value)) != i8::MAX, is_known);
            prop_assert_eq!(turns(Some(value)) != i16::MAX, is_known);
            prop_assert_eq!(kibibytes(Some(value)) != u32::MAX, is_known);
            let usage = Usage { used_bytes: bytes, total_bytes: bytes };
            prop_assert_ne!(mebibytes(Some(usage), |usage| usage.used_bytes), u32::MAX);
        }
    }
}
