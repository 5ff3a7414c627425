//! A battery: charge that is counted out, and a voltage that falls with it and sags under load.
//!
//! ```text
//! V = V_full - (V_full - V_empty)·(1 - s) - I·R        ṡ = -I/C
//! ```

/// What there is in it and how it was built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Battery {
    /// Charge when full.
    pub capacity_mah: f64,
    /// Voltage when full, at rest.
    pub full_v: f64,
    /// Voltage when empty, at rest.
    pub empty_v: f64,
    /// Inner resistance in ohms.
    pub resistance_ohm: f64,
    used_mah: f64,
    current_a: f64,
}

impl Battery {
    /// A full lithium battery of that many cells.
    pub fn lithium(cells: u8, capacity_mah: f64) -> Self {
        Self {
            capacity_mah,
            full_v: 4.2 * f64::from(cells),
            empty_v: 3.3 * f64::from(cells),
            resistance_ohm: 0.004 * f64::from(cells),
            used_mah: 0.0,
            current_a: 0.0,
        }
    }

    /// Draws a current for `dt` seconds.
    pub fn draw(&mut self, current_a: f64, dt: f64) {
        self.current_a = current_a;
        self.used_mah = (self.used_mah + current_a * dt / 3.6).min(self.capacity_mah);
    }

    /// Another one is put in, with that share of its charge left, 0 to 1.
    pub fn replace(&mut self, share: f64) {
        self.used_mah = (1.0 - share.clamp(0.0, 1.0)) * self.capacity_mah;
    }

    /// What is left, 0 to 1.
    pub fn share(&self) -> f64 {
        1.0 - self.used_mah / self.capacity_mah
    }

    /// What has been drawn.
    pub fn used_mah(&self) -> f64 {
        self.used_mah
    }

    /// What is being drawn.
    pub fn current_a(&self) -> f64 {
        self.current_a
    }

    /// Voltage at the terminals.
    pub fn voltage_v(&self) -> f64 {
        self.empty_v + (self.full_v - self.empty_v) * self.share()
            - self.current_a * self.resistance_ohm
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_battery_is_empty_after_its_capacity_and_sags_under_load() {
        let mut battery = Battery::lithium(4, 1000.0);
        let rest = battery.voltage_v();
        battery.draw(10.0, 0.0);
        assert!(
            (rest - battery.voltage_v() - 0.16).abs() < 1e-9,
            "10 A through 16 mOhm"
        );
        battery.draw(10.0, 180.0);
        assert!(
            (battery.share() - 0.5).abs() < 1e-9,
            "half an ampere-hour of one"
        );
        battery.draw(10.0, 1000.0);
        assert!(battery.share() >= 0.0 && battery.voltage_v() > 0.0);
    }
}
