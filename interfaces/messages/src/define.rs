//! `define_messages!`: struct, layout assertions, schema and hash of messages from one text.

/// Defines messages of a ROS 2 package; services elsewhere call it as `message!` of `fss-service`. `zerocopy` is where the
/// derive macros find that crate, since they know no `$crate`.
#[doc(hidden)]
#[macro_export]
macro_rules! define_messages {
    (zerocopy $zerocopy:tt; package $package:ident; $(
        #[doc = $doc:literal]
        $name:ident {
            $( consts { $( #[doc = $cdoc:literal] $cname:ident = $cvalue:literal; )* } )?
            $( #[doc = $fdoc:literal] $field:ident: $ty:ty ),* $(,)?
        }
    )*) => {
        $(
            #[doc = $doc]
            #[repr(C)]
            #[derive(
                Clone,
                Copy,
                Debug,
                PartialEq,
                $crate::private::zerocopy::IntoBytes,
                $crate::private::zerocopy::FromBytes,
                $crate::private::zerocopy::Immutable,
                $crate::private::zerocopy::KnownLayout,
            )]
            #[zerocopy(crate = $zerocopy)]
            pub struct $name {
                /// Counts the samples of one publisher from 1.
                pub sequence: u64,
                /// Time of measurement, ns on the monotonic clock.
                pub stamp_ns: u64,
                /// Time of publication, ns on the monotonic clock.
                pub published_ns: u64,
                $( #[doc = $fdoc] pub $field: $ty, )*
            }

            impl $name {
                $($( #[doc = $cdoc] pub const $cname: u8 = $cvalue; )*)?
            }

            impl Default for $name {
                fn default() -> Self {
                    <Self as $crate::Sample>::zeroed()
                }
            }

            impl $crate::Sample for $name {
                const PACKAGE: &'static str = stringify!($package);
                const NAME: &'static str = stringify!($name);
                const TYPE_NAME: &'static str = {
                    const LENGTH: usize = stringify!($package).len() + stringify!($name).len() + 18;
                    const BYTES: [u8; LENGTH] = $crate::private::type_name_bytes(
                        stringify!($package),
                        stringify!($name),
                        <$name as $crate::Sample>::HASH,
                    );
                    match core::str::from_utf8(&BYTES) {
                        Ok(name) => name,
                        Err(_) => stringify!($name),
                    }
                };
                const DOC: &'static str = $doc.trim_ascii();
                const FIELDS: &'static [$crate::Field] = &[
                    $crate::private::field!($name, sequence, u64, "counts the samples of one publisher from 1"),
                    $crate::private::field!($name, stamp_ns, u64, "time of measurement, ns, monotonic clock"),
                    $crate::private::field!($name, published_ns, u64, "time of publication, ns, monotonic clock"),
                    $( $crate::private::field!($name, $field, $ty, $fdoc.trim_ascii()), )*
                ];
                const CONSTANTS: &'static [$crate::Constant] = &[
                    $($( $crate::Constant { name: stringify!($cname), value: $cvalue, doc: $cdoc.trim_ascii() }, )*)?
                ];
                const HASH: u64 = $crate::private::layout_hash(Self::NAME, Self::FIELDS);

                fn header(&self) -> $crate::Header {
                    $crate::Header {
                        sequence: self.sequence,
                        stamp_ns: self.stamp_ns,
                        published_ns: self.published_ns,
                    }
                }

                fn set_header(&mut self, h: $crate::Header) {
                    (self.sequence, self.stamp_ns, self.published_ns) = (h.sequence, h.stamp_ns, h.published_ns);
                }
            }

            // SAFETY: the struct is repr(C) and holds only integers, floats and arrays of them, no pointer and no handle.
            #[allow(unsafe_code)]
            unsafe impl $crate::private::iceoryx2::prelude::ZeroCopySend for $name {
                unsafe fn type_name() -> &'static str {
                    <$name as $crate::Sample>::TYPE_NAME
                }
            }

            const _: () = {
                assert!(core::mem::align_of::<$name>() == 8, "a sample is aligned to 8 bytes");
                assert!(
                    $crate::private::is_cdr_layout(<$name as $crate::Sample>::FIELDS, core::mem::size_of::<$name>()),
                    "order the fields by size and fill with reserved bytes: the layout must be that of XCDR1"
                );
            };
        )*
    };
}

/// One field of a message's list of fields.
#[doc(hidden)]
#[macro_export]
macro_rules! message_field {
    ($sample:ident, $field:ident, $ty:ty, $doc:expr) => {
        $crate::Field {
            name: stringify!($field),
            doc: $doc,
            scalar: <$ty as $crate::FieldType>::SCALAR,
            count: <$ty as $crate::FieldType>::COUNT,
            offset: core::mem::offset_of!($sample, $field),
        }
    };
}

/// Defines messages of this stack, and a visit to each of their types.
macro_rules! samples {
    ($( #[doc = $doc:literal] $name:ident { $($body:tt)* } )*) => {
        $crate::define_messages! {
            zerocopy "zerocopy";
            package fss_msgs;
            $( #[doc = $doc] $name { $($body)* } )*
        }

        /// Calls the visitor with each sample type of this module, in the order of their definition.
        pub(super) fn visit(visitor: &mut impl $crate::SampleVisitor) {
            $( visitor.visit::<$name>(); )*
        }
    };
}

pub(crate) use samples;
