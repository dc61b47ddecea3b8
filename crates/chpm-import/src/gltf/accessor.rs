//! Accessors: numbers of any type, with any distance from one to the next, and those that replace some of them.

use super::document::{Document, Shape, entry, refused};
use super::views::{Region, Views};
use crate::error::ImportError;

/// Elements that are read at once.
pub(super) const WINDOW: usize = 1 << 14;
/// Elements that an accessor without a view may have.
const MOST_ZEROS: u64 = 1 << 24;

/// Type of an accessor's numbers.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of(code: u32) -> Option<Component> {
        Some(match code {
            5120 => Component::I8,
            5121 => Component::U8,
            5122 => Component::I16,
            5123 => Component::U16,
            5125 => Component::U32,
            5126 => Component::F32,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Component::I8 | Component::U8 => 1,
            Component::I16 | Component::U16 => 2,
            Component::U32 | Component::F32 => 4,
        }
    }

    /// The number at the front of some bytes.
    fn number(self, bytes: &[u8]) -> f64 {
        let four = || [bytes[0], bytes[1], bytes[2], bytes[3]];
        match self {
            Component::I8 => f64::from(bytes[0] as i8),
            Component::U8 => f64::from(bytes[0]),
            Component::I16 => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
            Component::U16 => f64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            Component::U32 => f64::from(u32::from_le_bytes(four())),
            Component::F32 => f64::from(f32::from_le_bytes(four())),
        }
    }

    /// Value that stands for one, where numbers are shares of it.
    fn one(self) -> f64 {
        match self {
            Component::I8 => 127.0,
            Component::U8 => 255.0,
            Component::I16 => 32767.0,
            Component::U16 => 65535.0,
            Component::U32 => f64::from(u32::MAX),
            Component::F32 => 1.0,
        }
    }
}

/// Elements in a stretch of bytes.
#[derive(Clone)]
struct Plain {
    region: Region,
    stride: u64,
    component: Component,
    width: usize,
}

impl Plain {
    /// Fails if `count` elements do not fit.
    fn new(
        region: &Region,
        offset: u64,
        stride: Option<u64>,
        (component, width): (Component, usize),
        count: u64,
        whose: &str,
    ) -> Result<Plain, ImportError> {
        let size = (component.size() * width) as u64;
        let stride = stride.unwrap_or(size);
        if stride < size {
            return Err(refused(format!(
                "{whose} has elements of {size} bytes, and the byteStride of its buffer view is {stride}: they would lie in one another"
            )));
        }
        let len =
            count.checked_sub(1).map_or(Some(0), |others| others.checked_mul(stride)?.checked_add(size));
        let len = len.ok_or_else(|| refused(format!("{whose} cannot have {count} elements")))?;
        let region = region.part(offset, len, whose)?;
        Ok(Plain { region, stride, component, width })
    }

    /// Appends the numbers of `count` elements from the element `first` on.
    fn read(&self, first: u64, count: usize, out: &mut Vec<f64>) -> Result<(), ImportError> {
        if count == 0 {
            return Ok(());
        }
        let (size, stride) = (self.component.size(), self.stride as usize);
        let mut bytes = vec![0; (count - 1) * stride + size * self.width];
        self.region.read(first * self.stride, &mut bytes)?;
        for element in 0..count {
            for number in 0..self.width {
                out.push(self.component.number(&bytes[element * stride + number * size..]));
            }
        }
        Ok(())
    }
}

/// Elements that replace others: their numbers, ascending, and what they are.
#[derive(Clone)]
struct Sparse {
    count: u64,
    indices: Plain,
    values: Plain,
}

/// An accessor that can be read.
#[derive(Clone)]
pub(super) struct Elements {
    number: u32,
    pub(super) count: u64,
    /// Numbers of an element.
    pub(super) width: usize,
    component: Component,
    is_normalized: bool,
    plain: Option<Plain>,
    sparse: Option<Sparse>,
}

impl Elements {
    /// Finds the bytes of an accessor whose elements are of one of these `shapes`.
    pub(super) fn open(
        number: u32,
        shapes: &[Shape],
        document: &Document,
        views: &mut Views<'_>,
    ) -> Result<Elements, ImportError> {
        let accessor = entry(&document.accessors, number, "accessor")?;
        let whose = format!("accessor {number}");
        if !shapes.contains(&accessor.shape) {
            return Err(refused(format!("{whose} is of type {:?}; expected {shapes:?}", accessor.shape)));
        }
        let width = match accessor.shape {
            Shape::Scalar => 1,
            Shape::Vec2 => 2,
            Shape::Vec3 => 3,
            _ => 4,
        };
        let of =
            |code| Component::of(code).ok_or_else(|| refused(format!("{whose} has component type {code}")));
        let component = of(accessor.component_type)?;
        let count = accessor.count;
        let plain = match accessor.buffer_view {
            None => None,
            Some(view) => {
                let (region, stride) = views.view(view)?;
                let offset = accessor.byte_offset;
                Some(Plain::new(&region, offset, stride, (component, width), count, &whose)?)
            }
        };

        let sparse = match &accessor.sparse {
            None => None,
            Some(sparse) if sparse.count > count => {
                return Err(refused(format!("{whose} replaces {} of its {count} elements", sparse.count)));
            }
            Some(sparse) => {
                let (region, _) = views.view(sparse.indices.buffer_view)?;
                let (kind, offset) = ((of(sparse.indices.component_type)?, 1), sparse.indices.byte_offset);
                let indices = Plain::new(&region, offset, None, kind, sparse.count, &whose)?;
                let (region, _) = views.view(sparse.values.buffer_view)?;
                let (kind, offset) = ((component, width), sparse.values.byte_offset);
                let values = Plain::new(&region, offset, None, kind, sparse.count, &whose)?;
                Some(Sparse { count: sparse.count, indices, values })
            }
        };
        if plain.is_none() && (sparse.is_none() || count > MOST_ZEROS) {
            return Err(refused(format!(
                "{whose} has no buffer view: its {count} elements would all be zero"
            )));
        }
        let is_normalized = accessor.normalized;
        Ok(Elements { number, count, width, component, is_normalized, plain, sparse })
    }

    /// Whether single precision holds every number.
    pub(super) fn are_singles(&self) -> bool {
        let is_share = self.is_normalized && self.component != Component::F32;
        !is_share && self.component != Component::U32
    }

    /// Takes integers for shares of the largest one; whether they were none before.
    pub(super) fn make_shares(&mut self) -> bool {
        let were_whole = !self.is_normalized && self.component != Component::F32;
        self.is_normalized |= were_whole;
        were_whole
    }

    /// Whether these can be vertex numbers.
    pub(super) fn are_indices(&self) -> bool {
        matches!(self.component, Component::U8 | Component::U16 | Component::U32)
    }

    /// Begins to read from the first element on.
    pub(super) fn reader(&self) -> Reader {
        Reader { elements: self.clone(), next: 0, replaced: 0, indices: Vec::new(), values: Vec::new() }
    }
}

/// Reads an accessor front to back.
pub(super) struct Reader {
    elements: Elements,
    next: u64,
    /// Replaced elements that are behind us, or in the window.
    replaced: u64,
    /// A window of the replaced elements that come next: last first.
    indices: Vec<f64>,
    values: Vec<f64>,
}

impl Reader {
    /// Numbers of an element.
    pub(super) fn width(&self) -> usize {
        self.elements.width
    }

    /// Elements that are left.
    pub(super) fn left(&self) -> u64 {
        self.elements.count - self.next
    }

    /// Refills `out` with the numbers of the next elements, a window of them at most.
    pub(super) fn read(&mut self, out: &mut Vec<f64>) -> Result<usize, ImportError> {
        let Elements { width, component, is_normalized, ref plain, .. } = self.elements;
        let count = self.left().min(WINDOW as u64) as usize;
        out.clear();
        match plain {
            Some(plain) => plain.read(self.next, count, out)?,
            None => out.resize(count * width, 0.0),
        }
        self.replace(count, out)?;
        if is_normalized {
            out.iter_mut().for_each(|x| *x = (*x / component.one()).max(-1.0));
        }
        self.next += count as u64;
        Ok(count)
    }

    fn replace(&mut self, count: usize, out: &mut [f64]) -> Result<(), ImportError> {
        let Elements { number, width, ref sparse, .. } = self.elements;
        let Some(sparse) = sparse else { return Ok(()) };
        let mut before = None;
        loop {
            if self.indices.is_empty() {
                let window = (sparse.count - self.replaced).min(WINDOW as u64) as usize;
                sparse.indices.read(self.replaced, window, &mut self.indices)?;
                self.values.clear();
                sparse.values.read(self.replaced, window, &mut self.values)?;
                self.replaced += window as u64;
                self.indices.reverse();
            }
            let Some(&index) = self.indices.last() else { return Ok(()) };
            let index = index as u64;
            // Ascending ones are never behind what was read.
            if index < self.next
                || before.is_some_and(|before| index <= before)
                || index >= self.elements.count
            {
                return Err(refused(format!("accessor {number} replaces element {index} out of order")));
            }
            if index >= self.next + count as u64 {
                return Ok(());
            }
            let value = self.values.len() - self.indices.len() * width;
            let place = (index - self.next) as usize * width;
            out[place..place + width].copy_from_slice(&self.values[value..value + width]);
            self.indices.pop();
            before = Some(index);
        }
    }
}
