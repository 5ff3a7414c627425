//! Sparse linear systems of 6 x 6 blocks, as pose graphs make them: symmetric and positive definite.
//!
//! Block elimination, always of the unknown with the fewest neighbours (minimum degree), so that a chain of keyframes with
//! a few loops stays sparse: a dense factorisation takes time in proportion to the cube of the number of keyframes.
//!
//! ```text
//! H_jk ← H_jk - H_jp·D_p⁻¹·H_pk      b_j ← b_j - H_jp·D_p⁻¹·b_p      x_p = D_p⁻¹·(b_p - Σ H_pj·x_j)
//! ```
//!
//! - A. George, J. W. H. Liu, *The Evolution of the Minimum Degree Ordering Algorithm*, SIAM Review 1989.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix6, Vector6};

/// `H·x = b`, by blocks of six unknowns.
pub(crate) struct BlockSystem {
    diagonal: Vec<Matrix6<f64>>,
    /// By row: the other blocks that are not zero, in both triangles.
    rows: Vec<BTreeMap<usize, Matrix6<f64>>>,
    right: Vec<Vector6<f64>>,
}

/// An eliminated unknown: `x = own - Σ link·x_of`.
struct Eliminated {
    index: usize,
    own: Vector6<f64>,
    links: Vec<(usize, Matrix6<f64>)>,
}

impl BlockSystem {
    /// All zero.
    pub(crate) fn new(size: usize) -> Self {
        Self {
            diagonal: vec![Matrix6::zeros(); size],
            rows: vec![BTreeMap::new(); size],
            right: vec![Vector6::zeros(); size],
        }
    }

    #[cfg(test)]
    pub(crate) fn right(&self, row: usize) -> &Vector6<f64> {
        &self.right[row]
    }

    /// Adds to `b`.
    pub(crate) fn add_right(&mut self, row: usize, part: &Vector6<f64>) {
        self.right[row] += part;
    }

    /// Adds to a block on the diagonal.
    pub(crate) fn add_diagonal(&mut self, row: usize, block: &Matrix6<f64>) {
        self.diagonal[row] += block;
    }

    /// Adds to a block beside the diagonal, and to its mirror image.
    pub(crate) fn add_pair(&mut self, row: usize, column: usize, block: &Matrix6<f64>) {
        *self.rows[row].entry(column).or_insert_with(Matrix6::zeros) += block;
        *self.rows[column].entry(row).or_insert_with(Matrix6::zeros) += block.transpose();
    }

    /// Marquardt's damping: each number on the diagonal grows by this share of itself, and by a trifle.
    pub(crate) fn damp(&mut self, share: f64) {
        for block in &mut self.diagonal {
            for i in 0..6 {
                block[(i, i)] += share * block[(i, i)] + 1e-9;
            }
        }
    }

    /// `x`; `None` unless `H` is positive definite.
    pub(crate) fn solve(mut self) -> Option<Vec<Vector6<f64>>> {
        let size = self.right.len();
        let mut queue: BTreeSet<(usize, usize)> =
            (0..size).map(|i| (self.rows[i].len(), i)).collect();
        let mut order = Vec::with_capacity(size);
        while let Some((_, pivot)) = queue.pop_first() {
            order.push(self.eliminate(pivot, &mut queue)?);
        }
        let mut found = vec![Vector6::zeros(); size];
        for step in order.iter().rev() {
            let known: Vector6<f64> = step.links.iter().map(|(j, link)| link * found[*j]).sum();
            found[step.index] = step.own - known;
        }
        let finite = found.iter().all(|x| x.iter().all(|c| c.is_finite()));
        finite.then_some(found)
    }

    fn eliminate(
        &mut self,
        pivot: usize,
        queue: &mut BTreeSet<(usize, usize)>,
    ) -> Option<Eliminated> {
        let factor = self.diagonal[pivot].cholesky()?;
        let own = factor.solve(&self.right[pivot]);
        let row = std::mem::take(&mut self.rows[pivot]);
        let links: Vec<(usize, Matrix6<f64>)> =
            row.iter().map(|(&j, h)| (j, factor.solve(h))).collect();
        for (&j, h) in &row {
            let mirrored = h.transpose();
            self.right[j] -= mirrored * own;
            let other = &mut self.rows[j];
            queue.remove(&(other.len(), j));
            other.remove(&pivot);
            for (k, link) in &links {
                let part = mirrored * link;
                if *k == j {
                    self.diagonal[j] -= part;
                } else {
                    *other.entry(*k).or_insert_with(Matrix6::zeros) -= part;
                }
            }
            queue.insert((other.len(), j));
        }
        Some(Eliminated {
            index: pivot,
            own,
            links,
        })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;

    #[test]
    fn a_sparse_system_has_the_solution_of_the_dense_one() {
        let size = 9;
        let wave = |i: usize, j: usize, f: f64| (i as f64 * 1.7 + j as f64 * f).sin();
        let pairs = [
            (0, 1),
            (1, 2),
            (2, 3),
            (3, 4),
            (5, 6),
            (6, 7),
            (7, 8),
            (4, 5),
            (0, 8),
            (2, 6),
        ];
        let mut sparse = BlockSystem::new(size);
        let mut dense = DMatrix::<f64>::zeros(6 * size, 6 * size);
        let mut right = DVector::<f64>::zeros(6 * size);
        for i in 0..size {
            let b = Vector6::from_fn(|r, _| wave(i, r, 0.9));
            sparse.add_right(i, &b);
            right.fixed_rows_mut::<6>(6 * i).copy_from(&b);
            let block = Matrix6::identity() * 30.0;
            sparse.add_diagonal(i, &block);
            dense.fixed_view_mut::<6, 6>(6 * i, 6 * i).copy_from(&block);
        }
        for (n, (i, j)) in pairs.into_iter().enumerate() {
            let block = Matrix6::from_fn(|r, c| wave(r + n, c, 2.3));
            sparse.add_pair(i, j, &block);
            dense.fixed_view_mut::<6, 6>(6 * i, 6 * j).copy_from(&block);
            dense
                .fixed_view_mut::<6, 6>(6 * j, 6 * i)
                .copy_from(&block.transpose());
        }
        let exact = dense.cholesky().expect("diagonally dominant").solve(&right);
        let found = sparse.solve().expect("the same");
        for (i, x) in found.iter().enumerate() {
            let off = (x - exact.fixed_rows::<6>(6 * i)).norm();
            assert!(off < 1e-10, "block {i} is {off} off");
        }
    }

    #[test]
    fn a_system_without_a_solution_has_none() {
        let mut system = BlockSystem::new(2);
        system.add_diagonal(0, &Matrix6::identity());
        system.add_diagonal(1, &Matrix6::identity());
        system.add_pair(0, 1, &(Matrix6::identity() * 2.0));
        assert!(system.solve().is_none(), "not positive definite");
        let mut nan = BlockSystem::new(1);
        nan.add_diagonal(0, &Matrix6::identity());
        nan.add_right(0, &Vector6::repeat(f64::NAN));
        assert!(nan.solve().is_none());
    }
}
