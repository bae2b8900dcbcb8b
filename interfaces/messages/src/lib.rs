//! Plain samples that processes share, and their schemas
