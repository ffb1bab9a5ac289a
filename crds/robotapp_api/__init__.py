"""The RobotApp API as code: models, schema generator, pure values and checks."""
