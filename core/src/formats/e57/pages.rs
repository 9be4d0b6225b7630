//! The checksummed pages that an E57 file is made of.
//!
//! Physical offsets count every byte of the file; logical offsets leave out the checksum that ends each page
//! (ASTM E2807).

use std::io::{Read, Seek, SeekFrom};

use crate::formats::error::{Result, fail};

/// Bytes of a page, checksum included. The standard allows no other.
pub const PAGE: usize = 1024;
/// Bytes of a page that carry content.
pub const PAYLOAD: usize = PAGE - 4;
/// Pages read at a time.
const BATCH: usize = 256;

/// The checksum that belongs at the end of a page: CRC-32C of its content, most significant byte first.
pub fn checksum(payload: &[u8]) -> [u8; 4] {
    crc32c::crc32c(payload).to_be_bytes()
}

/// Physical offset of a logical one.
pub fn physical(logical: u64) -> u64 {
    let payload = PAYLOAD as u64;
    logical / payload * PAGE as u64 + logical % payload
}

/// Reads logical bytes, checking the checksum of every page it touches.
pub struct PageReader<R> {
    inner: R,
    pages: u64,
    /// Content of the pages from `first_page`, without checksums.
    batch: Vec<u8>,
    first_page: u64,
    raw: Vec<u8>,
    position: u64,
}

impl<R: Read + Seek> PageReader<R> {
    /// Wraps a file; `position` is 0.
    pub fn new(mut inner: R) -> Result<Self> {
        let size = inner.seek(SeekFrom::End(0))?;
        if size % PAGE as u64 != 0 {
            fail!(
                whole,
                "it is cut short: {size} bytes are no whole number of {PAGE}-byte pages"
            );
        }
        Ok(Self {
            inner,
            pages: size / PAGE as u64,
            batch: Vec::new(),
            first_page: 0,
            raw: Vec::new(),
            position: 0,
        })
    }

    /// Logical bytes of the whole file.
    pub fn len(&self) -> u64 {
        self.pages * PAYLOAD as u64
    }

    /// Bytes of the whole file.
    pub fn physical_len(&self) -> u64 {
        self.pages * PAGE as u64
    }

    /// Logical position of the next read.
    pub fn position(&self) -> u64 {
        self.position
    }

    /// Goes to a logical offset.
    pub fn seek(&mut self, logical: u64) {
        self.position = logical;
    }

    /// Logical offset of a physical one; none where that is beyond the file or within a checksum.
    pub fn logical(&self, physical: u64) -> Option<u64> {
        let (page, within) = (physical / PAGE as u64, physical % PAGE as u64);
        (page < self.pages && within < PAYLOAD as u64).then(|| page * PAYLOAD as u64 + within)
    }

    /// Fills `out` from the current position.
    pub fn read_exact(&mut self, mut out: &mut [u8]) -> Result<()> {
        while !out.is_empty() {
            let available = self.available()?;
            let taken = available.len().min(out.len());
            out[..taken].copy_from_slice(&available[..taken]);
            out = &mut out[taken..];
            self.position += taken as u64;
        }
        Ok(())
    }

    /// The bytes at the current position that are in memory; never empty.
    fn available(&mut self) -> Result<&[u8]> {
        let start = self.first_page * PAYLOAD as u64;
        if self.position < start || self.position >= start + self.batch.len() as u64 {
            self.load(self.position / PAYLOAD as u64)?;
        }
        let within = self.position - self.first_page * PAYLOAD as u64;
        Ok(&self.batch[within as usize..])
    }

    fn load(&mut self, page: u64) -> Result<()> {
        if page >= self.pages {
            fail!(whole, "it is cut short: it refers to data beyond its end");
        }
        let count = (self.pages - page).min(BATCH as u64) as usize;
        self.batch.clear();
        self.raw.resize(count * PAGE, 0);
        self.inner.seek(SeekFrom::Start(page * PAGE as u64))?;
        self.inner.read_exact(&mut self.raw)?;
        self.first_page = page;
        for (index, raw) in self.raw.chunks_exact(PAGE).enumerate() {
            if checksum(&raw[..PAYLOAD]) != raw[PAYLOAD..] {
                if index == 0 {
                    fail!(byte page * PAGE as u64,
                        "the checksum of the page does not match: the file is damaged there"
                    );
                }
                // The pages before this one are good; the error comes when this one is asked for.
                break;
            }
            self.batch.extend_from_slice(&raw[..PAYLOAD]);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    /// Pages whose content counts up, 251 apart.
    fn file(pages: usize) -> (Vec<u8>, Vec<u8>) {
        let content: Vec<u8> = (0..pages * PAYLOAD).map(|i| (i % 251) as u8).collect();
        let file = content
            .chunks(PAYLOAD)
            .flat_map(|part| [part, &checksum(part)].concat())
            .collect();
        (file, content)
    }

    #[test]
    fn the_checksum_is_the_standards() {
        // RFC 3720, appendix B.4: 32 bytes of zeros.
        assert_eq!(checksum(&[0; 32]), [0x8a, 0x91, 0x36, 0xaa]);
    }

    #[test]
    fn reads_cross_pages_and_batches() {
        let (file, content) = file(3 * BATCH);
        let mut pages = PageReader::new(Cursor::new(file)).unwrap();
        assert_eq!(pages.len(), content.len() as u64);
        for (start, length) in [
            (0, 10),
            (1015, 20),
            (BATCH * PAYLOAD - 5, 5000),
            (100, 2 * BATCH * PAYLOAD),
            (content.len() - 7, 7),
        ] {
            pages.seek(start as u64);
            let mut read = vec![0; length];
            pages.read_exact(&mut read).unwrap();
            assert_eq!(read, content[start..start + length]);
        }
        pages.seek(content.len() as u64 - 1);
        assert!(pages.read_exact(&mut [0; 2]).is_err());
    }

    #[test]
    fn a_damaged_page_is_named_and_the_others_are_read() {
        let (mut file, content) = file(4);
        file[2 * PAGE + 500] ^= 1;
        let mut pages = PageReader::new(Cursor::new(file)).unwrap();
        let mut good = vec![0; 2 * PAYLOAD];
        pages.read_exact(&mut good).unwrap();
        assert_eq!(good, content[..2 * PAYLOAD]);
        let error = pages.read_exact(&mut [0]).unwrap_err();
        assert_eq!(error.place, crate::formats::error::Place::Byte(2048));
        pages.seek(3 * PAYLOAD as u64);
        pages.read_exact(&mut [0]).unwrap();
    }

    #[test]
    fn offsets_into_checksums_or_beyond_the_end_do_not_exist() {
        let pages = PageReader::new(Cursor::new(file(2).0)).unwrap();
        assert_eq!(pages.logical(1024), Some(1020));
        assert_eq!(physical(1020), 1024);
        for offset in [1020, 1023, 2044, 2048, u64::MAX] {
            assert_eq!(pages.logical(offset), None);
        }
        assert!(PageReader::new(Cursor::new(vec![0; 1500])).is_err());
    }
}
