//! The plant file, actuators, sensors and the effects that a plant can have
