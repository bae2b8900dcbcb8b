//! Mission sequencer: phases, their goals and when they end
