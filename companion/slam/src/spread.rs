//! Picks corners evenly over the image: a quadtree is split, largest and fullest node first, until it has as many nodes
//! as corners are wanted; each node keeps its strongest.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::fast::Corner;

struct Node {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
    corners: Vec<Corner>,
}

/// At most about `wanted` of `corners`, spread over an image of this size.
pub(crate) fn spread(
    corners: Vec<Corner>,
    width: usize,
    height: usize,
    wanted: usize,
) -> Vec<Corner> {
    if corners.len() <= wanted {
        return corners;
    }
    let mut nodes = vec![Node {
        left: 0,
        top: 0,
        width,
        height,
        corners,
    }];
    // (depth, corners, index): shallow ones first makes it breadth-first, so even in space.
    let mut queue = BinaryHeap::from([(Reverse(0u32), nodes[0].corners.len(), Reverse(0usize))]);
    let mut live = 1;
    while live < wanted
        && let Some((Reverse(depth), _, Reverse(index))) = queue.pop()
    {
        let node = &mut nodes[index];
        if node.width.max(node.height) < 2 {
            continue;
        }
        let parts = split(node);
        live -= 1;
        for part in parts.into_iter().filter(|part| !part.corners.is_empty()) {
            live += 1;
            if part.corners.len() > 1 {
                queue.push((Reverse(depth + 1), part.corners.len(), Reverse(nodes.len())));
            }
            nodes.push(part);
        }
    }
    let best = |node: &Node| {
        node.corners
            .iter()
            .copied()
            .max_by_key(|c| (c.score, Reverse((c.y, c.x))))
    };
    nodes.iter().filter_map(best).collect()
}

/// The four quarters of a node, which is left empty.
fn split(node: &mut Node) -> [Node; 4] {
    let (w, h) = (node.width.div_ceil(2), node.height.div_ceil(2));
    let (left, top) = (node.left, node.top);
    let part = |left: usize, top: usize, width: usize, height: usize| Node {
        left,
        top,
        width,
        height,
        corners: Vec::new(),
    };
    let mut parts = [
        part(left, top, w, h),
        part(left + w, top, node.width - w, h),
        part(left, top + h, w, node.height - h),
        part(left + w, top + h, node.width - w, node.height - h),
    ];
    for corner in std::mem::take(&mut node.corners) {
        let (right, low) = (corner.x >= left + w, corner.y >= top + h);
        parts[usize::from(right) + 2 * usize::from(low)]
            .corners
            .push(corner);
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crowded_quarter_does_not_starve_the_rest() {
        let crowd = (0..900).map(|i| Corner {
            x: i % 30,
            y: i / 30,
            score: 200,
        });
        let lonely = [(200, 30), (60, 200), (220, 220)].map(|(x, y)| Corner { x, y, score: 8 });
        let kept = spread(crowd.chain(lonely).collect(), 256, 256, 50);
        assert!(kept.len() >= 50 && kept.len() <= 53, "{} kept", kept.len());
        for corner in lonely {
            assert!(kept.contains(&corner), "{corner:?} lost");
        }
    }

    #[test]
    fn few_corners_are_all_kept() {
        let one = vec![Corner {
            x: 1,
            y: 1,
            score: 9,
        }];
        assert_eq!(spread(one.clone(), 4, 4, 10), one);
    }
}
