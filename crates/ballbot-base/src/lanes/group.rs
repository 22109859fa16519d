//! Structs of numbers that are processed number by number: in registers, in memory, or of one robot of eight.

use super::{Quat, Vec3};
use crate::payload::{Payload, PayloadMotion};
use crate::wheels::Wheels;

/// A number `T`, or a group of them such as a vector: a field of a struct of [`lane_struct!`](crate::lane_struct!).
pub trait Group<T> {
    /// Count of the numbers.
    const LEN: usize;

    /// The group of other numbers.
    type Of<U>;

    /// The group of the results of `f`, called in order.
    fn from_fn(f: &mut impl FnMut() -> T) -> Self;

    /// The group of the results of `f` for each number, in order.
    fn map<U>(&self, f: &mut impl FnMut(&T) -> U) -> Self::Of<U>;

    /// Calls `f` with each number and its counterpart in `other`, in order.
    fn zip_mut<U>(&mut self, other: &Self::Of<U>, f: &mut impl FnMut(&mut T, &U));
}

/// The group of the results of `f`, called in order.
#[inline(always)]
pub(super) fn group_of<T, G: Group<T>>(mut f: impl FnMut() -> T) -> G {
    G::from_fn(&mut f)
}

/// Calls `f` with each number of a group, in order.
#[inline(always)]
pub(super) fn each<T, G: Group<T>>(group: &G, mut f: impl FnMut(&T)) {
    group.map(&mut f);
}

impl<T> Group<T> for T {
    const LEN: usize = 1;

    type Of<U> = U;

    #[inline(always)]
    fn from_fn(f: &mut impl FnMut() -> T) -> T {
        f()
    }

    #[inline(always)]
    fn map<U>(&self, f: &mut impl FnMut(&T) -> U) -> U {
        f(self)
    }

    #[inline(always)]
    fn zip_mut<U>(&mut self, other: &U, f: &mut impl FnMut(&mut T, &U)) {
        f(self, other);
    }
}

/// Written out, because `map` of an array may not be inlined, and then the function is compiled for the baseline
/// instruction set.
macro_rules! arrays {
    (@repeat $i:literal $item:expr) => { $item };
    ($([$item:ty => $of:ty; $len:literal] $($i:literal)*;)*) => {$(
        impl<T> Group<T> for [$item; $len] {
            const LEN: usize = $len * <$item as Group<T>>::LEN;

            type Of<U> = [$of; $len];

            #[inline(always)]
            fn from_fn(f: &mut impl FnMut() -> T) -> Self {
                [$(arrays!(@repeat $i <$item as Group<T>>::from_fn(f))),*]
            }

            #[inline(always)]
            fn map<U>(&self, f: &mut impl FnMut(&T) -> U) -> Self::Of<U> {
                [$(<$item as Group<T>>::map(&self[$i], f)),*]
            }

            #[inline(always)]
            fn zip_mut<U>(&mut self, other: &Self::Of<U>, f: &mut impl FnMut(&mut T, &U)) {
                $(<$item as Group<T>>::zip_mut(&mut self[$i], &other[$i], f);)*
            }
        }
    )*};
}

arrays! {
    [T => U; 2] 0 1;
    [T => U; 3] 0 1 2;
    [T => U; 4] 0 1 2 3;
    [T => U; 6] 0 1 2 3 4 5;
    [[T; 3] => [U; 3]; 2] 0 1;
    [[T; 3] => [U; 3]; 3] 0 1 2;
    [Wheels<T> => Wheels<U>; 3] 0 1 2;
    [Payload<T> => Payload<U>; 2] 0 1;
    [PayloadMotion<T> => PayloadMotion<U>; 2] 0 1;
}

macro_rules! wheels {
    ($($item:ty => $of:ty;)*) => {$(
        impl<T> Group<T> for Wheels<$item> {
            const LEN: usize = <[$item; 3] as Group<T>>::LEN;

            type Of<U> = Wheels<$of>;

            #[inline(always)]
            fn from_fn(f: &mut impl FnMut() -> T) -> Self {
                Self(<[$item; 3] as Group<T>>::from_fn(f))
            }

            #[inline(always)]
            fn map<U>(&self, f: &mut impl FnMut(&T) -> U) -> Self::Of<U> {
                Wheels(<[$item; 3] as Group<T>>::map(&self.0, f))
            }

            #[inline(always)]
            fn zip_mut<U>(&mut self, other: &Self::Of<U>, f: &mut impl FnMut(&mut T, &U)) {
                <[$item; 3] as Group<T>>::zip_mut(&mut self.0, &other.0, f);
            }
        }
    )*};
}

wheels! {
    T => U;
    [T; 3] => [U; 3];
    Wheels<T> => Wheels<U>;
}

/// Implements [`Group`] for a struct of groups.
#[doc(hidden)]
#[macro_export]
macro_rules! group_of_fields {
    ($name:ident<$t:ident> { $($field:ident: $type:ty,)* }) => {
        impl<$t> $crate::lanes::Group<$t> for $name<$t> {
            const LEN: usize = 0 $(+ <$type as $crate::lanes::Group<$t>>::LEN)*;

            type Of<U> = $name<U>;

            #[inline(always)]
            fn from_fn(f: &mut impl FnMut() -> $t) -> Self {
                Self { $($field: <$type as $crate::lanes::Group<$t>>::from_fn(f),)* }
            }

            #[inline(always)]
            fn map<U>(&self, f: &mut impl FnMut(&$t) -> U) -> $name<U> {
                $name { $($field: <$type as $crate::lanes::Group<$t>>::map(&self.$field, f),)* }
            }

            #[inline(always)]
            fn zip_mut<U>(&mut self, other: &$name<U>, f: &mut impl FnMut(&mut $t, &U)) {
                $(<$type as $crate::lanes::Group<$t>>::zip_mut(&mut self.$field, &other.$field, f);)*
            }
        }
    };
}

group_of_fields!(Vec3<T> { x: T, y: T, z: T, });
group_of_fields!(Quat<T> { w: T, v: Vec3<T>, });

/// Defines a struct of numbers in registers ([`Lane`](crate::lanes::Lane)) or in memory
/// ([`Cell`](crate::lanes::Cell)), with functions of all its numbers. A field is a number, an array of 2, 3, 4 or 6 of
/// them, a [`Vec3`](crate::lanes::Vec3), a [`Quat`](crate::lanes::Quat), [`Wheels`](crate::wheels::Wheels), or another
/// such struct.
///
/// ```
/// use ballbot_base::lanes::{Eight, Vec3, lane_struct};
///
/// lane_struct! {
///     /// Where a robot is, and how fast.
///     #[derive(Clone, Copy, Debug, Default, PartialEq)]
///     pub struct Motion<T> {
///         pub position: Vec3<T>,
///         pub speed: T,
///     }
/// }
///
/// let one = Motion { position: Vec3::new(1.0, 2.0, 3.0), speed: 4.0 };
/// let mut eight = Motion::<Eight>::default();
/// eight.set_lane(5, &one);
/// assert_eq!(eight.lane(5), one);
/// assert_eq!(eight.lane(4), Motion::default());
/// ```
#[macro_export]
macro_rules! lane_struct {
    ($(#[$meta:meta])* $vis:vis struct $name:ident<$t:ident> {
        $($(#[$doc:meta])* $field_vis:vis $field:ident: $type:ty),* $(,)?
    }) => {
        $(#[$meta])*
        $vis struct $name<$t> {
            $($(#[$doc])* $field_vis $field: $type,)*
        }

        $crate::group_of_fields!($name<$t> { $($field: $type,)* });

        #[allow(dead_code, reason = "few structs need all functions")]
        impl<$t> $name<$t> {
            /// Count of the numbers.
            $vis const LEN: usize = <Self as $crate::lanes::Group<$t>>::LEN;

            /// The results of `f`, called in the order of the fields.
            #[inline(always)]
            $vis fn from_fn(mut f: impl FnMut() -> $t) -> Self {
                $crate::lanes::Group::from_fn(&mut f)
            }

            /// The results of `f` for each number.
            #[inline(always)]
            $vis fn map<U>(&self, mut f: impl FnMut(&$t) -> U) -> $name<U> {
                $crate::lanes::Group::<$t>::map(self, &mut f)
            }

            /// Calls `f` with each number and its counterpart in `other`.
            #[inline(always)]
            $vis fn zip_mut<U>(&mut self, other: &$name<U>, mut f: impl FnMut(&mut $t, &U)) {
                $crate::lanes::Group::<$t>::zip_mut(self, other, &mut f);
            }
        }

        #[allow(dead_code, reason = "few structs need all functions")]
        impl<$t: $crate::lanes::Cell> $name<$t> {
            /// Reads the numbers.
            #[inline(always)]
            $vis fn load<L: $crate::lanes::Lane<Cell = $t>>(&self, token: L::Token) -> $name<L> {
                self.map(
                    #[inline(always)]
                    |cell| L::load(token, cell),
                )
            }

            /// Writes numbers.
            #[inline(always)]
            $vis fn store<L: $crate::lanes::Lane<Cell = $t>>(&mut self, numbers: &$name<L>) {
                self.zip_mut(
                    numbers,
                    #[inline(always)]
                    |cell, number| number.store(cell),
                );
            }

            /// The numbers of one robot.
            #[inline]
            $vis fn lane(&self, index: usize) -> $name<f64> {
                self.map(|cell| cell.get(index))
            }

            /// Replaces the numbers of one robot.
            #[inline]
            $vis fn set_lane(&mut self, index: usize, one: &$name<f64>) {
                self.zip_mut(one, |cell, number| cell.set(index, *number));
            }
        }

        #[allow(dead_code, reason = "few structs need all functions")]
        impl<$t: $crate::lanes::Lane> $name<$t> {
            /// Selection of `yes` where `mask` is true, of `no` elsewhere.
            #[inline(always)]
            $vis fn select(mask: $t::Mask, yes: &Self, no: &Self) -> Self {
                let mut out = no.map(
                    #[inline(always)]
                    |number| *number,
                );
                out.zip_mut(
                    yes,
                    #[inline(always)]
                    |out, yes| *out = <$t as $crate::lanes::Lane>::select(mask, *yes, *out),
                );
                out
            }
        }
    };
}
