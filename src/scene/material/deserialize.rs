//! Reading of a scene's `[material]`, in which keys that are not settings are tissues.

use super::{MaterialEntry, TissueEntry};
use crate::mesh::ElementOrder;
use crate::physics::{MaterialModel, VolumetricFormulation};
use crate::scene::element_order::OrderChoice;
use crate::scene::keywords::damping_kind;
use serde::de::{DeserializeSeed, Error as _, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::fmt;

/// Deserialises the settings with their types; every other key is a tissue. Implemented by hand
/// because serde's `flatten` loses the line of an error.
impl<'de> Deserialize<'de> for MaterialEntry {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        from.deserialize_map(Entries)
    }
}

/// Reads the table of `[material]`.
struct Entries;

impl<'de> Visitor<'de> for Entries {
    type Value = MaterialEntry;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a table of settings and tissues")
    }

    fn visit_map<A: MapAccess<'de>>(
        self,
        mut map: A,
    ) -> std::result::Result<MaterialEntry, A::Error> {
        let mut entry = MaterialEntry::default();
        while let Some(key) = map.next_key::<String>()? {
            match key.as_str() {
                "model" => entry.model = Some(map.next_value_seed(Model)?),
                "poisson" => entry.poisson = Some(map.next_value()?),
                "volume" => entry.volume = Some(map.next_value_seed(Volume)?),
                "order" => entry.order = Some(map.next_value_seed(Order)?),
                "young" => entry.young = Some(map.next_value()?),
                "stiffness" => entry.stiffness = Some(map.next_value()?),
                "stiffness_field" => entry.stiffness_field = Some(map.next_value()?),
                "density" => entry.density = Some(map.next_value()?),
                "damping" => entry.damping = Some(map.next_value()?),
                "damping_ratio" => entry.damping_ratio = Some(map.next_value()?),
                "damping_hz" => entry.damping_hz = Some(map.next_value()?),
                "damping_kind" => entry.damping_kind = map.next_value_seed(Kind)?,
                "max_stiffness_ratio" => entry.max_stiffness_ratio = Some(map.next_value()?),
                _ => {
                    let tissue = map.next_value_seed(Named(&key))?;
                    entry.tissues.insert(key, tissue);
                }
            }
        }
        // The command line may still set the model if the scene does not.
        let springs = entry.model == Some(MaterialModel::Springs);
        if springs || entry.stiffness.is_some() {
            entry
                .check_rigid(MaterialModel::Springs)
                .map_err(A::Error::custom)?;
        }
        Ok(entry)
    }
}

/// The name of a material model.
struct Model;

impl<'de> DeserializeSeed<'de> for Model {
    type Value = MaterialModel;

    fn deserialize<D: Deserializer<'de>>(
        self,
        from: D,
    ) -> std::result::Result<MaterialModel, D::Error> {
        String::deserialize(from)?.parse().map_err(D::Error::custom)
    }
}

/// The name of a volumetric formulation.
struct Volume;

impl<'de> DeserializeSeed<'de> for Volume {
    type Value = VolumetricFormulation;

    fn deserialize<D: Deserializer<'de>>(
        self,
        from: D,
    ) -> std::result::Result<VolumetricFormulation, D::Error> {
        String::deserialize(from)?.parse().map_err(D::Error::custom)
    }
}

/// The order of the elements, as a number.
struct Order;

/// A number, or `auto`.
#[derive(Deserialize)]
#[serde(untagged, expecting = "order must be 1, 2 or \"auto\"")]
enum OrderValue {
    Number(i64),
    Text(String),
}

impl OrderValue {
    fn choice(&self) -> crate::Result<OrderChoice> {
        match self {
            OrderValue::Number(number) => {
                ElementOrder::from_number(*number).map(OrderChoice::Exactly)
            }
            OrderValue::Text(text) => text.parse(),
        }
    }
}

impl<'de> DeserializeSeed<'de> for Order {
    type Value = OrderChoice;

    fn deserialize<D: Deserializer<'de>>(
        self,
        from: D,
    ) -> std::result::Result<OrderChoice, D::Error> {
        OrderValue::deserialize(from)?
            .choice()
            .map_err(D::Error::custom)
    }
}

/// The name of a damping kind.
struct Kind;

impl<'de> DeserializeSeed<'de> for Kind {
    type Value = Option<String>;

    fn deserialize<D: Deserializer<'de>>(
        self,
        from: D,
    ) -> std::result::Result<Self::Value, D::Error> {
        damping_kind(from)
    }
}

/// A tissue whose errors contain its name.
struct Named<'a>(&'a str);

impl<'de> DeserializeSeed<'de> for Named<'_> {
    type Value = TissueEntry;

    fn deserialize<D: Deserializer<'de>>(
        self,
        from: D,
    ) -> std::result::Result<TissueEntry, D::Error> {
        TissueEntry::deserialize(from).map_err(|e| D::Error::custom(format!("`{}` is {e}", self.0)))
    }
}
