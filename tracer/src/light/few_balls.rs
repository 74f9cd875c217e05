//! A few shining spheres, one of which is chosen by place, ready to be sampled for many points at once.

use super::{AtOnce, Ball, Choice, Drawn, Lights, alias, tree::Root};
use crate::math::{Rgb, Vec2, Vec3, select};

/// Spheres below the only node of a light tree, and nothing else that shines. What is chosen has the bits of
/// [`Lights::for_each`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct FewBalls {
    root: Root,
    /// Of each child; of those that are missing, anything.
    balls: [Ball; 4],
}

impl FewBalls {
    /// The child that `pick` and `u` choose for the reference point `p` with normal `n`, its probability, and whether there
    /// is one. Without branches, so that loops over it become vector code.
    #[inline(always)]
    pub fn pick(&self, p: Vec3, n: Vec3, pick: f32, u: Vec2) -> (u32, f32, bool) {
        let u = alias::lengthen(pick, u);
        self.root.sample(p, n, select(u < 1.0 - f64::EPSILON, u, 1.0 - f64::EPSILON))
    }

    /// The sphere of a child that was chosen with this probability.
    #[inline(always)]
    pub fn ball(&self, child: u32, chosen: f32) -> Ball {
        let number = |of: fn(&Ball) -> f32| of_child(self.balls.each_ref().map(of), child);
        Ball {
            emitter: 0,
            center: Vec3::new(number(|b| b.center.x), number(|b| b.center.y), number(|b| b.center.z)),
            radius: number(|b| b.radius),
            two_sided: number(|b| f32::from(u8::from(b.two_sided))) != 0.0,
            radiance: Rgb::new(number(|b| b.radiance.x), number(|b| b.radiance.y), number(|b| b.radiance.z)),
            chosen,
        }
    }

    /// Emitter of each child.
    pub fn emitters(&self) -> [u32; 4] {
        self.balls.map(|ball| ball.emitter)
    }
}

/// The one of four numbers that is a child's.
#[inline(always)]
pub(crate) fn of_child(numbers: [f32; 4], child: u32) -> f32 {
    let low = select(child == 0, numbers[0], numbers[1]);
    select(child < 2, low, select(child == 2, numbers[2], numbers[3]))
}

impl Lights {
    /// The lights, where they are such, chosen by place and to be sampled at once.
    pub(crate) fn few_balls(&self, at_once: AtOnce) -> Option<FewBalls> {
        let Choice::Tree(tree) = &self.choice else { return None };
        let (root, sources) = tree.root()?;
        let at_once = self.that_suit(at_once);
        let ball = |k: usize| match self.left(sources[k], 1.0, at_once) {
            Some(Drawn::Ball(ball)) => Some(ball),
            _ => None,
        };
        Some(FewBalls { root, balls: [ball(0)?, ball(1)?, ball(2)?, ball(3)?] })
    }
}
