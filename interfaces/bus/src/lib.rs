//! Topics, rates, deadlines and the loop that runs a service
