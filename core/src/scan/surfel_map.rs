//! A prepared scan as the kernels for pairs use it: surfels at several spacings, and what the station saw.

use std::sync::OnceLock;

use nalgebra::{Point3, Vector3};

use crate::scan::free_space::FreeSpace;
use crate::spatial::hash_grid::{NeighbourGrid, thinned};

/// Neighbours are searched up to this many spacings away.
const SEARCH: f32 = 1.5;
/// Levels besides the finest: each doubles the spacing of the one before.
const COARSER: usize = 7;
/// Spacing (m) at which surfaces are compared: far and grazing ones have no closer surfels.
pub const COMPARED_SPACING: f64 = 0.2;

/// What a surfel is part of, by how likely that is to stay where it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Of no planar patch: furniture, plants, people, steps, far and thinly seen surface.
    Loose,
    /// Of a planar patch that a vehicle or furniture may have.
    Patch,
    /// Of a planar patch too large to be of something that moves: static structure.
    Static,
}

/// How many kinds there are.
pub const KINDS: usize = 3;

/// Points without a normal: surface only where another station saw a plane.
#[derive(Default)]
struct Thin {
    points: Vec<[f32; 3]>,
    variances: Vec<f32>,
}

/// What one station compares with the planes of another.
pub struct Moving {
    pub point: Point3<f64>,
    /// Absent where the station saw too few points for a plane.
    pub normal: Option<Vector3<f64>>,
    /// Of its offset along the normal (m^2).
    pub variance: f64,
    pub kind: Kind,
}

/// Surfels with a normal, in scanner-centred coordinates, and thin points.
pub struct SurfelLevel {
    /// Distance between neighbours, about (m).
    pub spacing: f64,
    pub points: Vec<[f32; 3]>,
    pub normals: Vec<[f32; 3]>,
    /// Variance of a surfel's offset along its normal (m^2): noise and roughness over its own points.
    pub variances: Vec<f32>,
    pub kinds: Vec<Kind>,
    thin: Thin,
    /// Surface that each surfel stands for, then each thin point (m^2); where it is not told, a voxel's face.
    areas: Vec<f32>,
    /// Made when it is first asked for: the finest surfels are compared, and seldom searched.
    grid: OnceLock<NeighbourGrid>,
}

impl SurfelLevel {
    fn new(
        points: Vec<[f32; 3]>,
        normals: Vec<[f32; 3]>,
        variances: Vec<f32>,
        kinds: Vec<Kind>,
        spacing: f64,
    ) -> Self {
        Self {
            spacing,
            points,
            normals,
            variances,
            kinds,
            thin: Thin::default(),
            areas: Vec::new(),
            grid: OnceLock::new(),
        }
    }

    /// One surfel of each voxel of the spacing, and one thin point.
    fn thinned(&self, spacing: f64) -> Self {
        let kept = thinned(&self.points, spacing as f32);
        let mut coarser = Self::new(
            picked(&self.points, &kept),
            picked(&self.normals, &kept),
            picked(&self.variances, &kept),
            picked(&self.kinds, &kept),
            spacing,
        );
        let kept_thin = thinned(&self.thin.points, spacing as f32);
        coarser.thin = Thin {
            points: picked(&self.thin.points, &kept_thin),
            variances: picked(&self.thin.variances, &kept_thin),
        };
        if !self.areas.is_empty() {
            let (of_surfels, of_thin) = self.areas.split_at(self.points.len());
            coarser.areas = picked(of_surfels, &kept);
            coarser.areas.extend(picked(of_thin, &kept_thin));
        }
        coarser
    }

    /// The surfel nearest to a point, if there is one within the radius (m), at most 1.5 spacings.
    pub fn nearest(&self, point: [f32; 3], radius: f32) -> Option<usize> {
        let made = || NeighbourGrid::new(&self.points, SEARCH * self.spacing as f32);
        self.grid.get_or_init(made).nearest(point, radius)
    }

    /// Indices of about `samples` surfels, evenly drawn.
    pub fn drawn(&self, samples: usize) -> impl Iterator<Item = usize> + Clone + use<> {
        evenly(self.points.len(), samples)
    }

    /// Of thin points, about `samples`, evenly drawn.
    pub fn thin_drawn(&self, samples: usize) -> impl Iterator<Item = usize> + Clone + use<> {
        let surfels = self.points.len();
        evenly(self.thin.points.len(), samples).map(move |index| surfels + index)
    }

    /// So many of the thin points that they are drawn in the proportion of the surfels.
    pub fn thin_share(&self, samples: usize) -> usize {
        let surfels = self.points.len();
        self.thin.points.len() * samples.min(surfels) / surfels.max(1)
    }

    /// Surface that a surfel stands for, or a thin point by its index after those of all surfels (m^2).
    pub fn area(&self, index: usize) -> f64 {
        let face = self.spacing * self.spacing;
        self.areas.get(index).map_or(face, |&area| f64::from(area))
    }

    /// A surfel, or a thin point by its index after those of all surfels.
    pub fn moving(&self, index: usize) -> Moving {
        let vector = |v: [f32; 3]| Vector3::from(v.map(f64::from));
        if let Some(thin) = index.checked_sub(self.points.len()) {
            return Moving {
                point: vector(self.thin.points[thin]).into(),
                normal: None,
                variance: f64::from(self.thin.variances[thin]),
                kind: Kind::Loose,
            };
        }
        Moving {
            point: vector(self.points[index]).into(),
            normal: Some(vector(self.normals[index])),
            variance: f64::from(self.variances[index]),
            kind: self.kinds[index],
        }
    }
}

/// About `samples` of so many indices, evenly drawn.
fn evenly(count: usize, samples: usize) -> impl Iterator<Item = usize> + Clone {
    let drawn = samples.min(count);
    (0..drawn).map(move |i| i * count / drawn)
}

fn picked<T: Copy>(values: &[T], indices: &[u32]) -> Vec<T> {
    indices.iter().map(|&i| values[i as usize]).collect()
}

/// The surfels of one station at every spacing, and its free space.
pub struct SurfelMap {
    finest: SurfelLevel,
    /// Finest first; a level is made when it is first asked for.
    coarser: [OnceLock<SurfelLevel>; COARSER],
    pub free_space: FreeSpace,
    /// Points and normals of planes that were seen too thinly for surfels: they are drawn on plans only.
    pub sparse_planes: Vec<([f32; 3], [f32; 3])>,
}

impl SurfelMap {
    pub fn new(
        points: Vec<[f32; 3]>,
        normals: Vec<[f32; 3]>,
        variances: Vec<f32>,
        kinds: Vec<Kind>,
        spacing: f64,
        free_space: FreeSpace,
    ) -> Self {
        Self {
            finest: SurfelLevel::new(points, normals, variances, kinds, spacing),
            coarser: Default::default(),
            free_space,
            sparse_planes: Vec::new(),
        }
    }

    /// Adds points that were seen too thinly for planes of their own, and the variances of their offsets from the surface.
    pub fn with_thin(mut self, points: Vec<[f32; 3]>, variances: Vec<f32>) -> Self {
        self.finest.thin = Thin { points, variances };
        self.coarser = Default::default();
        self
    }

    /// Says how much surface each surfel and then each thin point stands for (m^2).
    pub fn with_areas(mut self, areas: Vec<f32>) -> Self {
        self.finest.areas = areas;
        self.coarser = Default::default();
        self
    }

    /// Surface of the surfels and of thin points (m^2): one face of a voxel each, at the spacing of comparisons.
    pub fn area(&self) -> f64 {
        let level = self.level(COMPARED_SPACING);
        let count = level.points.len() + level.thin.points.len();
        count as f64 * level.spacing * level.spacing
    }

    /// All surfels.
    pub fn finest(&self) -> &SurfelLevel {
        &self.finest
    }

    /// The finest surfels that are at least `spacing` (m) apart, or the coarsest there are.
    pub fn level(&self, spacing: f64) -> &SurfelLevel {
        let of_level = |level: usize| self.finest.spacing * f64::from(1 << level);
        let level = (0..COARSER)
            .find(|&level| of_level(level) >= 0.999 * spacing)
            .unwrap_or(COARSER);
        match level.checked_sub(1) {
            None => &self.finest,
            Some(coarser) => {
                self.coarser[coarser].get_or_init(|| self.finest.thinned(of_level(level)))
            }
        }
    }

    /// Of this map and another, surfels about `distance` (m) apart, the same for both and no closer than comparisons need.
    pub fn levels<'a>(&'a self, other: &'a Self, distance: f64) -> [&'a SurfelLevel; 2] {
        let spacing = distance
            .max(COMPARED_SPACING)
            .max(self.finest.spacing)
            .max(other.finest.spacing);
        [self.level(spacing), other.level(spacing)]
    }
}
