//! What is no FMU for this service is refused, with the reason.
#![allow(clippy::unwrap_used)]

use fss_fmu::model::{Kind, Model};
use std::io::Write;
use std::path::Path;

/// An archive with this description.
fn archive(folder: &Path, description: &str) -> std::path::PathBuf {
    let path = folder.join("model.fmu");
    let mut zip = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
    zip.start_file("modelDescription.xml", zip::write::SimpleFileOptions::default()).unwrap();
    zip.write_all(description.as_bytes()).unwrap();
    zip.finish().unwrap();
    path
}

const DESCRIPTION: &str = r#"<?xml version="1.0"?>
<fmiModelDescription fmiVersion="2.0" modelName="m" guid="{1}">
<CoSimulation modelIdentifier="m" canHandleVariableCommunicationStepSize="true"/>
<TypeDefinitions><SimpleType name="Angle"><Real unit="rad"/></SimpleType></TypeDefinitions>
<ModelVariables>
<ScalarVariable name="angle" valueReference="4" causality="input"><Real declaredType="Angle"/></ScalarVariable>
<ScalarVariable name="count" valueReference="1" causality="output"><Integer/></ScalarVariable>
<ScalarVariable name="words" valueReference="2" causality="output"><String/></ScalarVariable>
</ModelVariables>
</fmiModelDescription>"#;

#[test]
fn variables_have_types_and_units_of_their_own_or_of_their_type() {
    let folder = tempfile::tempdir().unwrap();
    let model = Model::read(&archive(folder.path(), DESCRIPTION)).unwrap();
    let angle = &model.variables["angle"];
    assert_eq!((angle.reference, angle.kind, angle.unit.as_deref()), (4, Some(Kind::Real), Some("rad")));
    assert_eq!(model.variables["count"].kind, Some(Kind::Integer));
    assert_eq!(model.variables["words"].kind, None);
    assert!(model.takes_any_step);
    let missing = model.unpack(&folder.path().join("unpacked")).unwrap_err().to_string();
    assert!(missing.contains("binaries/linux64/m.so"), "{missing}");
}

#[test]
fn what_is_no_fmu_for_co_simulation_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (from, to, why) in [
        ("2.0", "1.0", "FMI 1.0 is not known"),
        ("CoSimulation", "ModelExchange", "model exchange only"),
        ("</fmiModelDescription>", "", "modelDescription.xml"),
    ] {
        let refused = Model::read(&archive(folder.path(), &DESCRIPTION.replace(from, to))).unwrap_err().to_string();
        assert!(refused.contains(why), "{refused}");
    }
}
