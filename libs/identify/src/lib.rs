//! Calibration, misfit, causes and extended models
