//! Options of a controller that include the options of others.

/// Joins structs of fields into one: the fields of the first struct, then the fields of the next.
macro_rules! joined_fields {
    ($joined:ty: $($part:ident $Part:ty),+) => {
        impl ::ballbot_base::fields::Fields for $joined {
            const FIELDS: &'static [::ballbot_base::fields::Field] = &{
                use ::ballbot_base::fields::{Field, Fields};
                const PARTS: &[&[Field]] = &[$(<$Part as Fields>::FIELDS),+];
                let mut fields = [PARTS[0][0]; 0 $(+ <$Part as Fields>::FIELDS.len())+];
                let (mut part, mut first, mut i) = (0, 0, 0);
                while i < fields.len() {
                    if i == first + PARTS[part].len() {
                        (first, part) = (i, part + 1);
                    }
                    fields[i] = PARTS[part][i - first];
                    i += 1;
                }
                fields
            };

            fn values(&self, index: usize) -> &[f64] {
                let mut first = 0;
                $(
                    let index_in_part = index - first;
                    first += <$Part as ::ballbot_base::fields::Fields>::FIELDS.len();
                    if index < first {
                        return self.$part.values(index_in_part);
                    }
                )+
                panic!("{index} is not below {first}, the number of fields")
            }

            fn values_mut(&mut self, index: usize) -> &mut [f64] {
                let mut first = 0;
                $(
                    let index_in_part = index - first;
                    first += <$Part as ::ballbot_base::fields::Fields>::FIELDS.len();
                    if index < first {
                        return self.$part.values_mut(index_in_part);
                    }
                )+
                panic!("{index} is not below {first}, the number of fields")
            }
        }
    };
}

pub(crate) use joined_fields;
