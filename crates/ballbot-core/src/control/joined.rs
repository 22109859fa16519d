//! Options of a law that has those of another.

/// Makes a struct of two structs of fields one: first the fields of one, then those of the other.
macro_rules! joined_fields {
    ($both:ty: $first:ident $First:ty, $second:ident $Second:ty) => {
        impl $crate::fields::Fields for $both {
            const FIELDS: &'static [$crate::fields::Field] = &{
                use $crate::fields::{Field, Fields};
                const FIRST: &[Field] = <$First as Fields>::FIELDS;
                const SECOND: &[Field] = <$Second as Fields>::FIELDS;
                let mut fields = [FIRST[0]; FIRST.len() + SECOND.len()];
                let mut i = 1;
                while i < fields.len() {
                    fields[i] = if i < FIRST.len() { FIRST[i] } else { SECOND[i - FIRST.len()] };
                    i += 1;
                }
                fields
            };

            fn values(&self, index: usize) -> &[f64] {
                match index.checked_sub(<$First as $crate::fields::Fields>::FIELDS.len()) {
                    None => self.$first.values(index),
                    Some(index) => self.$second.values(index),
                }
            }

            fn values_mut(&mut self, index: usize) -> &mut [f64] {
                match index.checked_sub(<$First as $crate::fields::Fields>::FIELDS.len()) {
                    None => self.$first.values_mut(index),
                    Some(index) => self.$second.values_mut(index),
                }
            }
        }
    };
}

pub(super) use joined_fields;
