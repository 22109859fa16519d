//! Options of a controller that include the options of others.

/// Defines a struct of structs of fields: with the fields of the first struct, then the fields of the next.
macro_rules! joined_fields {
    ($(#[$meta:meta])* pub struct $joined:ident { $($(#[$doc:meta])* pub $part:ident: $Part:ty,)+ }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        pub struct $joined {
            $($(#[$doc])* pub $part: $Part,)+
        }

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

            fn defaults() -> Self {
                Self::default()
            }

            fn slices(&self) -> impl Iterator<Item = &[f64]> {
                ::std::iter::empty()$(.chain(self.$part.slices()))+
            }

            fn slices_mut(&mut self) -> impl Iterator<Item = &mut [f64]> {
                ::std::iter::empty()$(.chain(self.$part.slices_mut()))+
            }
        }
    };
}

pub(crate) use joined_fields;
