//! Base controller: guidance, thruster allocation and modulation
