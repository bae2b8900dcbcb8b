//! Samples on their way from the service to the tape.

/// A block holds this much; it is made once and used again and again.
const BLOCK_BYTES: usize = 1 << 16;
/// In front of each sample: topic and length.
const PREFIX_LEN: usize = 8;

/// Samples one after another, each with its topic's number.
#[derive(Debug)]
pub(crate) struct Block {
    bytes: Vec<u8>,
    samples: usize,
}

impl Block {
    pub(crate) fn new() -> Self {
        // Touched once here, so that memory does not grow as blocks come into use.
        let mut bytes = vec![u8::MAX; BLOCK_BYTES];
        bytes.clear();
        Self { bytes, samples: 0 }
    }

    /// Appends a sample; false where it does not fit.
    pub(crate) fn push(&mut self, topic: usize, sample: &[u8]) -> bool {
        if self.bytes.len() + PREFIX_LEN + sample.len() > BLOCK_BYTES {
            return false;
        }
        self.bytes.extend_from_slice(&(topic as u32).to_le_bytes());
        self.bytes.extend_from_slice(&(sample.len() as u32).to_le_bytes());
        self.bytes.extend_from_slice(sample);
        self.samples += 1;
        true
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.samples == 0
    }

    pub(crate) fn clear(&mut self) {
        self.bytes.clear();
        self.samples = 0;
    }

    /// Each sample with its topic's number.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (usize, &[u8])> {
        let mut rest = &self.bytes[..];
        std::iter::from_fn(move || {
            let (prefix, behind) = rest.split_first_chunk::<PREFIX_LEN>()?;
            let [t0, t1, t2, t3, l0, l1, l2, l3] = *prefix;
            let (sample, next) = behind.split_at_checked(u32::from_le_bytes([l0, l1, l2, l3]) as usize)?;
            rest = next;
            Some((u32::from_le_bytes([t0, t1, t2, t3]) as usize, sample))
        })
    }
}
