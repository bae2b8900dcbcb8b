//! What a service may know of where it flies.

use serde::de::DeserializeOwned;

/// Why a service could not be made: any error, or a text.
pub type Refusal = Box<dyn std::error::Error + Send + Sync>;

/// What a service may know of where it flies, before its first step.
#[derive(Clone, Debug, Default)]
pub struct Site {
    /// Steps a second, as the launch file has it.
    pub rate_hz: f64,
    /// How often the service has been started in this run; 1 for the first time.
    pub starts: u32,
    /// The vehicle's name; empty where it is alone.
    pub vehicle: String,
    /// The plant file.
    pub plant_text: String,
    /// The mission file.
    pub mission_text: String,
}

impl Site {
    /// What a service wants of the plant file: a type with the fields that it needs.
    ///
    /// ```
    /// use fss_service::Site;
    /// use serde::Deserialize;
    ///
    /// #[derive(Deserialize)]
    /// struct Plant {
    ///     base: Base,
    /// }
    /// #[derive(Deserialize)]
    /// struct Base {
    ///     mass_kg: f64,
    /// }
    ///
    /// let site = Site { plant_text: "[base]\nmass_kg = 10.1\nwidth_m = 0.3".to_owned(), ..Site::default() };
    /// let plant: Plant = site.plant()?;
    /// assert_eq!(plant.base.mass_kg, 10.1);
    /// # Ok::<(), fss_service::Refusal>(())
    /// ```
    ///
    /// # Errors
    /// Where the file does not have them.
    pub fn plant<T: DeserializeOwned>(&self) -> std::result::Result<T, Refusal> {
        toml::from_str(&self.plant_text).map_err(|e| format!("plant file: {e}").into())
    }

    /// What a service wants of the mission file.
    ///
    /// # Errors
    /// Where the file does not have it.
    pub fn mission<T: DeserializeOwned>(&self) -> std::result::Result<T, Refusal> {
        toml::from_str(&self.mission_text).map_err(|e| format!("mission file: {e}").into())
    }
}
