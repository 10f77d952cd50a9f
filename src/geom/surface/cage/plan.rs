//! The subdivision of one quad's neighbourhood until its surface is bicubic, for any points.
//!
//! Feature-adaptive subdivision: Nießner, Loop, Meyer, DeRose, "Feature-adaptive GPU rendering of Catmull-Clark
//! subdivision surfaces", ACM Transactions on Graphics 31(1), 2012. Here it ends not at a chosen depth with an
//! approximation, but where the rest repeats (`pattern`).

use super::around::Neighbourhood;
use super::crease::{Strip, strips};
use super::level::Cage;
use super::masks::Row;
use super::pattern::Pattern;
use super::settled::{Quad, Sector};
use super::sparse::Rows;
use crate::base::error::{Error, Result};
use std::collections::HashMap;
use std::sync::Arc;

/// Levels around an irregular vertex whose points are stored, although the pattern could give them.
const STORED: u8 = 2;

/// More levels than any sharpness lasts: 10, and those until all irregular vertices are alone in their quads.
const MAX_LEVELS: usize = 24;

/// A part of the quad.
#[derive(Debug, Clone, Copy)]
pub(super) enum Node {
    /// The first of four nodes: those at corners 0 to 3.
    Split(u32),
    /// The first of 16 numbers of points in `Plan::lists`.
    Regular(u32),
    /// The first of a ring's numbers of points, the pattern, and the irregular corner.
    Irregular(u32, u32, u32),
    /// The first of 16 numbers for each of the patches along a crease, how many there are, and the side of the crease.
    /// Patch i spans the distances from it of 2^−(i + 1) to 2^−i, the last one the rest.
    Creased(u32, u32, u32),
}

/// The subdivision of a neighbourhood's quad. Points are numbered: the neighbourhood's vertices, then one a row.
#[derive(Debug)]
pub struct Plan {
    pub(super) vertices: u32,
    pub(super) rows: Rows,
    pub(super) nodes: Vec<Node>,
    pub(super) lists: Vec<u32>,
    pub(super) patterns: Vec<Arc<Pattern>>,
    /// Levels of stored points.
    pub(super) depth: u32,
    /// Most points in a sum.
    pub(super) longest: u32,
}

impl Plan {
    /// Number of control points: the vertices of the neighbourhood.
    pub fn control_points(&self) -> usize {
        self.vertices as usize
    }

    /// Number of points that are kept for evaluation, control points included.
    pub fn points(&self) -> usize {
        self.vertices as usize + self.rows.len()
    }

    /// True if the quad is one bicubic patch.
    pub fn is_regular(&self) -> bool {
        matches!(self.nodes[0], Node::Regular(_))
    }
}

/// Sectors with equal patterns, and the length of the ring, which varies at non-manifold vertices.
type Kind = (Sector, usize);

/// Plans by neighbourhood, made at first use. Quads with equal topology and sharpness around them share one.
#[derive(Debug, Default)]
pub struct Plans {
    plans: HashMap<Neighbourhood, Arc<Plan>>,
    patterns: HashMap<Kind, Arc<Pattern>>,
}

impl Plans {
    /// No plans yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Number of plans made.
    pub fn len(&self) -> usize {
        self.plans.len()
    }

    /// True if no plan was made.
    pub fn is_empty(&self) -> bool {
        self.plans.is_empty()
    }

    /// Drops all plans, which stay valid for their holders.
    pub fn clear(&mut self) {
        self.plans.clear();
    }

    /// The plan of a neighbourhood.
    ///
    /// # Errors
    /// [`Error::Internal`] only for defects of this module.
    pub fn plan(&mut self, neighbourhood: &Neighbourhood) -> Result<Arc<Plan>> {
        if let Some(plan) = self.plans.get(neighbourhood) {
            return Ok(plan.clone());
        }
        let plan = Arc::new(Builder::new(neighbourhood, &mut self.patterns).built()?);
        self.plans.insert(neighbourhood.clone(), plan.clone());
        Ok(plan)
    }
}

/// A quad of a level that is to be split.
#[derive(Clone, Copy)]
struct Active {
    face: u32,
    node: usize,
    /// Levels to store once it is settled.
    left: u8,
}

struct Builder<'a> {
    known: &'a mut HashMap<Kind, Arc<Pattern>>,
    /// Number of each of `plan.patterns`.
    used: HashMap<Kind, u32>,
    plan: Plan,
    /// The cage of the level and the number of each of its points.
    level: Arc<Cage>,
    points: Vec<u32>,
    active: Vec<Active>,
    walk: Vec<u32>,
    /// Most patches along a crease.
    creases: u32,
}

impl<'a> Builder<'a> {
    fn new(neighbourhood: &Neighbourhood, known: &'a mut HashMap<Kind, Arc<Pattern>>) -> Self {
        let (rows, lists, patterns) = (Rows::default(), Vec::new(), Vec::new());
        let nodes = vec![Node::Split(0)];
        let vertices = neighbourhood.vertices;
        let plan = Plan { vertices, rows, nodes, lists, patterns, depth: 0, longest: 0 };
        let (active, walk, points) = (Vec::new(), Vec::new(), (0..vertices).collect());
        Builder {
            known,
            used: HashMap::new(),
            plan,
            level: Arc::new(neighbourhood.cage()),
            points,
            active,
            walk,
            creases: 0,
        }
    }

    fn built(mut self) -> Result<Plan> {
        // Other faces than quads become quads first, and the neighbourhood begins at the corner of this one.
        if self.level.topology.face_size(0) != 4 {
            self.active.push(Active { face: 0, node: 0, left: STORED });
            self.deeper();
        }
        self.settle(0, 0, STORED)?;
        for _ in 0..MAX_LEVELS {
            if self.active.is_empty() {
                self.prune();
                return Ok(self.plan);
            }
            self.split()?;
        }
        Err(Error::Internal("subdivision of a face does not end".to_string()))
    }

    /// Goes one level down around the active quads, whose children come first; takes these quads off the list.
    fn deeper(&mut self) {
        let faces: Vec<u32> = self.active.iter().map(|active| active.face).collect();
        let (part, vertices) = self.level.around(&faces);
        self.plan.depth += 1;
        self.points = vertices.iter().map(|&vertex| self.points[vertex as usize]).collect();
        let first = self.plan.points() as u32;
        let (count, edges) = (part.vertex_count() as u32, part.child_of_edge(0));
        let mut row = Row::new();
        // Points of faces first: the others refer to them.
        let point_of_face = |child: u32| first + child - count;
        for child in (count..edges).chain(0..count).chain(edges..part.child_count() as u32) {
            part.mask(child, &mut row);
            row.iter_mut().filter(|_| child < count || child >= edges).for_each(|entry| {
                entry.0 = if entry.0 < count { self.points[entry.0 as usize] } else { point_of_face(entry.0) };
            });
            if (count..edges).contains(&child) {
                row.iter_mut().for_each(|entry| entry.0 = self.points[entry.0 as usize]);
            }
            self.plan.rows.push(&mut row);
        }
        let faces = edges - count;
        let of_vertices = (0..count).map(|vertex| first + faces + vertex);
        let of_faces = (0..faces).map(|face| first + face);
        let of_edges = (edges..part.child_count() as u32).map(|child| first + child);
        self.points = of_vertices.chain(of_faces).chain(of_edges).collect();
        self.level = Arc::new(part.refined());
        self.active.clear();
    }

    /// Splits all active quads.
    fn split(&mut self) -> Result<()> {
        let split = self.active.clone();
        self.deeper();
        for (quad, parent) in split.iter().enumerate() {
            let first = self.plan.nodes.len();
            self.plan.nodes[parent.node] = Node::Split(first as u32);
            self.plan.nodes.extend([Node::Split(0); 4]);
            for corner in 0..4 {
                self.settle(4 * quad as u32 + corner, first + corner as usize, parent.left)?;
            }
        }
        Ok(())
    }

    /// Makes a quad of the level a leaf, or active.
    fn settle(&mut self, face: u32, node: usize, left: u8) -> Result<()> {
        let level = self.level.clone();
        let level = level.as_ref();
        let mut walk = std::mem::take(&mut self.walk);
        let state = level.state(face, &mut walk);
        self.walk = walk;
        match state {
            Quad::Regular => self.plan.nodes[node] = Node::Regular(self.add_patch(level, face)),
            Quad::Creased(side, sharpness) => self.plan.nodes[node] = self.crease(level, face, side, sharpness),
            Quad::Irregular(corner, sector) if left == 0 => {
                let list = self.plan.lists.len() as u32;
                let ring = level.ring(face, corner);
                let pattern = self.pattern(level, face, corner, (sector, ring.len()))?;
                self.plan.lists.extend(ring.iter().map(|&vertex| self.points[vertex as usize]));
                self.plan.nodes[node] = Node::Irregular(list, pattern, corner);
            }
            Quad::Irregular(..) => self.active.push(Active { face, node, left: left - 1 }),
            Quad::Unsettled => self.active.push(Active { face, node, left }),
        }
        Ok(())
    }

    fn add_patch(&mut self, level: &Cage, face: u32) -> u32 {
        let list = self.plan.lists.len() as u32;
        let grid = self.grid(level, face, 0);
        self.plan.lists.extend(grid);
        list
    }

    /// Numbers of the 16 control points of a quad.
    fn grid(&mut self, level: &Cage, face: u32, corner: u32) -> [u32; 16] {
        level.control_points(face, corner).map(|mut point| {
            if let [(vertex, _)] = point[..] {
                return self.points[vertex as usize];
            }
            point.iter_mut().for_each(|entry| entry.0 = self.points[entry.0 as usize]);
            self.plan.rows.push(&mut point);
            self.plan.points() as u32 - 1
        })
    }

    fn crease(&mut self, level: &Cage, face: u32, side: u32, sharpness: f32) -> Node {
        let list = self.plan.lists.len() as u32;
        let first = self.grid(level, face, side);
        let control: Strip = std::array::from_fn(|row| std::array::from_fn(|column| first[4 * row + column]));
        let patches = strips(control, sharpness, |row| {
            self.plan.rows.push(row);
            self.plan.points() as u32 - 1
        });
        self.plan.lists.extend(patches.iter().flatten().flatten());
        self.creases = self.creases.max(patches.len() as u32);
        Node::Creased(list, patches.len() as u32, side)
    }

    fn pattern(&mut self, level: &Cage, face: u32, corner: u32, kind: Kind) -> Result<u32> {
        if let Some(&number) = self.used.get(&kind) {
            return Ok(number);
        }
        let pattern = match self.known.get(&kind) {
            Some(pattern) => pattern.clone(),
            None => Arc::new(Pattern::new(level, face, corner, kind.0)?),
        };
        self.known.insert(kind, pattern.clone());
        self.plan.patterns.push(pattern);
        let number = self.plan.patterns.len() as u32 - 1;
        self.used.insert(kind, number);
        Ok(number)
    }

    /// Drops rows on which no patch or ring depends.
    fn prune(&mut self) {
        let (vertices, rows) = (self.plan.vertices as usize, &self.plan.rows);
        let mut used = vec![false; self.plan.points()];
        self.plan.lists.iter().for_each(|&point| used[point as usize] = true);
        for i in (0..rows.len()).rev().map(|i| i + vertices) {
            if used[i] {
                rows.row(i - vertices).iter().for_each(|&(j, _)| used[j as usize] = true);
            }
        }
        let mut number: Vec<u32> = (0..vertices as u32).collect();
        let (mut kept, mut next) = (Rows::default(), vertices as u32);
        for i in 0..rows.len() {
            number.push(next);
            if used[i + vertices] {
                kept.push(&mut rows.row(i).iter().map(|&(j, weight)| (number[j as usize], weight)).collect());
                next += 1;
            }
        }
        self.plan.lists.iter_mut().for_each(|point| *point = number[*point as usize]);
        let patterns =
            self.plan.patterns.iter().flat_map(|pattern| [pattern.ring.longest(), pattern.children.longest()]);
        self.plan.longest = patterns.fold(kept.longest(), usize::max) as u32;
        self.plan.rows = kept;
        self.plan.depth += self.creases;
    }
}
