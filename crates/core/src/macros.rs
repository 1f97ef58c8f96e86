//! Macros that avoid repetition: trait implementations for references and boxes, and methods that set a field.

/// Implements a trait for references and boxes of its implementers. Methods that take `&self` are listed after `ref`,
/// those that take `&mut self` after `mut`.
macro_rules! forward {
    ($Trait:ident for $($Owner:ty),*; $methods:tt) => { $(forward! { @ $Trait, $Owner, $methods })* };
    (@ $Trait:ident, $Owner:ty, {
        $(ref $name:ident($($arg:ident: $Arg:ty),*) $(-> $Result:ty)?;)*
        $(mut $change:ident($($given:ident: $Given:ty),*) $(-> $Changed:ty)?;)*
    }) => {
        impl<T: $Trait + ?Sized> $Trait for $Owner {
            $(
                #[inline]
                fn $name(&self $(, $arg: $Arg)*) $(-> $Result)? {
                    (**self).$name($($arg),*)
                }
            )*

            $(
                #[inline]
                fn $change(&mut self $(, $given: $Given)*) $(-> $Changed)? {
                    (**self).$change($($given),*)
                }
            )*
        }
    };
}

pub(crate) use forward;

/// Declares methods that set one field each: the method's documentation, its name, and the field with its type.
macro_rules! setters {
    ($($(#[$doc:meta])* $set:ident($field:ident: $Type:ty);)*) => {$(
        $(#[$doc])*
        #[inline]
        #[must_use]
        pub const fn $set(mut self, $field: $Type) -> Self {
            self.$field = $field;
            self
        }
    )*};
}

pub(crate) use setters;
