//! Link communication: 5 Hz datagrams to and from each arm link
